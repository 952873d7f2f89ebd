"""The live page: what it may ask for, who may ask, what is rendered, and the page itself in a real browser."""

import asyncio
import base64
import contextlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from browser import PATIENCE, barriers, opened
from engines import plain_paths

from raytwin.errors import InputError
from raytwin.fast import trace
from raytwin.renderers.user_renderers import UserRenderer
from raytwin.scene import Scene
from raytwin.scene.scene_files import read_scene
from raytwin.scene_folders import SCENES
from raytwin.show.live import Server, opening_page
from raytwin.show.live.light_path import light_path
from raytwin.show.live.progressive import Session
from raytwin.show.live.server import Worker
from raytwin.show.live.view_state import ViewRequest, from_json, from_link, scene_toml, wanted_of

pytestmark = pytest.mark.nightly

SIZE = 96, 72
LONG = PATIENCE / 1000
"""Seconds to wait for anything."""


@contextlib.contextmanager
def serving(server: Server) -> Iterator[None]:
    """The server at work in a thread of its own, which ends as Ctrl-C ends it."""
    loop = asyncio.new_event_loop()
    task = loop.create_task(server.serve())

    def run() -> None:
        asyncio.set_event_loop(loop)
        with pytest.raises(asyncio.CancelledError):
            loop.run_until_complete(task)

    thread = threading.Thread(target=run)
    thread.start()
    yield
    loop.call_soon_threadsafe(task.cancel)
    thread.join(LONG)
    assert not thread.is_alive()
    server.worker.thread.join()
    loop.close()


@pytest.fixture(scope="module")
def live(base):
    session = Session(base)
    server = Server(session, first=msgspec.structs.replace(wanted_of(base, session.engines[0]), samples=4))
    with serving(server):
        yield server


# ------------------------------------------------------------------------------------------ what may be asked


def test_a_wish_survives_json_and_the_link(base):
    wish = msgspec.structs.replace(wanted_of(base, "numpy64"), rung="sky", depth=3, samples=16)
    text = msgspec.json.encode(wish)
    assert from_json(text) == wish
    link = "http://127.0.0.1:1/#view=" + base64.urlsafe_b64encode(text).decode().rstrip("=")
    assert from_link(link) == wish
    with pytest.raises(InputError, match="--view: expected a link"):
        from_link("http://127.0.0.1:1/#view=e")


def test_what_may_not_be_asked_is_named():
    for text, said in (
        ('{"rung": "radiosity"}', "rung"),
        ('{"samples": 100000}', "4096"),
        ('{"spheres": [{"center": [0, 0, 0], "radius": -1}]}', "radius"),
        ('{"sun": {"to_light": [0, 0, NaN]}}', "invalid"),
        ('{"camera": {"R_cam_board": [[1, 0, 0], [0, 1, 0], [0, 0, 2]], "t_cam_board": [0, 0, 1]}}', "a rotation"),
        ("{", "truncated"),
    ):
        with pytest.raises(InputError, match=said):
            from_json(text)


def saved(base: Scene, wish: ViewRequest, folder: Path) -> Scene:
    """What the page would save, read again."""
    (folder / "mine").mkdir()
    (folder / "mine" / "scene.toml").write_text(scene_toml(base, wish, SCENES / "studio"), encoding="utf-8")
    return read_scene(folder / "mine")


def test_the_saved_scene_is_the_one_that_was_shown_from_where_it_was_seen(base, tmp_path):
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    R = (np.array(base.camera.R_cam_board) @ turn).tolist()
    camera = {"R_cam_board": R, "t_cam_board": base.camera.t_cam_board, "zoom": 2.0}
    spheres = [{"center": [0.01, 0.02, 0.06], "radius": 0.03}]
    wish = from_json(msgspec.json.encode({"camera": camera, "spheres": spheres}))
    shown = wish.scene(base)
    assert np.allclose(shown.camera.R_cam_board, R)
    assert (shown.camera.fx, shown.camera.cx) == (2 * base.camera.fx, base.camera.cx)
    assert msgspec.structs.replace(saved(base, wish, tmp_path), name=base.name) == shown


def test_a_map_stays_and_is_never_named_by_the_page(scenes, tmp_path):
    base = read_scene(scenes / "studio")
    wish = wanted_of(base, "numpy64")
    assert ".exr" not in msgspec.json.encode(wish).decode()
    shown, again = wish.scene(base), saved(base, wish, tmp_path)
    assert (shown.sun, shown.environment) == (base.sun, base.environment)
    assert (again.sun, again.environment) == (shown.sun, shown.environment)


# ------------------------------------------------------------------------------------------ what is rendered


class Slow:
    """A session whose passes wait to be let on."""

    def __init__(self) -> None:
        self.begun, self.go = threading.Event(), threading.Event()

    def passes(self, wanted):
        for _ in range(3):
            self.begun.set()
            self.go.wait(LONG)
            yield {"kind": "picture"}, ()


@pytest.fixture
def slow():
    """(a session that waits, a worker at it, the messages to the page, each by its head)"""
    session, messages = Slow(), []
    worker, loop = Worker(session), asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()

    async def send(message: bytes) -> None:
        messages.append(json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")]))

    worker.start(loop)
    yield session, worker, messages, send
    session.go.set()
    worker.stop()
    worker.thread.join()
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def wait_for(true) -> None:
    deadline = time.monotonic() + LONG
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


def test_of_wishes_in_a_row_only_the_first_and_the_last_are_rendered(slow):
    session, worker, messages, send = slow
    worker.want(1, ViewRequest(), send)
    assert session.begun.wait(LONG)
    for number in range(2, 8):
        worker.want(number, ViewRequest(), send)
    session.go.set()
    for count in range(1, 5):
        wait_for(lambda count=count: len(messages) == count)  # none before the page has answered the last
        worker.answer(messages[-1]["sent"], send)
    assert [head["number"] for head in messages] == [1, 7, 7, 7]  # the first was stopped between two of its passes


def test_a_page_that_does_not_read_is_told_nothing_more_once_another_takes_over(slow):
    """Their numbers are their own: a higher one of another page's would pass for a later wish."""
    session, worker, messages, send = slow
    begun, read = threading.Event(), threading.Event()

    async def never(message: bytes) -> None:
        begun.set()
        while not read.is_set():
            await asyncio.sleep(0.01)
        begun.clear()

    session.go.set()
    worker.want(7, ViewRequest(), never)
    assert begun.wait(LONG)
    worker.want(1, ViewRequest(), send)
    wait_for(lambda: messages)
    assert messages[0]["number"] == 1
    read.set()
    wait_for(lambda: not begun.is_set())


def test_an_error_that_ends_threads_is_told_and_the_worker_goes_on(slow, capsys):
    session, worker, messages, send = slow
    for number, error in enumerate((KeyboardInterrupt, SystemExit, GeneratorExit, ValueError)):
        session.passes = lambda wanted, error=error: (_ for _ in ()).throw(error("mine"))
        worker.want(number, ViewRequest(), send)
        wait_for(lambda n=number: len(messages) == n + 1)
        assert messages[-1]["kind"] == "refused"
        worker.answer(messages[-1]["sent"], send)
    assert "ValueError: mine" in capsys.readouterr().err


def test_passes_go_on_with_twice_the_samples_until_all_are_there(base):
    wish = msgspec.structs.replace(wanted_of(base, "drjit32"), samples=4)
    events = [event for event, _ in Session(base).passes(wish)]
    points = [(e["side"], e["samples"]) for e in events if e["kind"] == "point"]
    assert points == [("tracer", 1), ("twin", 1), ("twin", 2), ("twin", 4)]
    errors = {(e["side"], e["samples"]): e["error"] for e in events if e["kind"] == "point"}
    # The tracer lacks light, which no samples bring; the twin's noise falls as 1/sqrt(n).
    assert 1.2 < errors["twin", 1] / errors["twin", 4] < 3.3
    assert [e["kind"] for e in events].count("ledger") == 1
    assert events[-1]["kind"] == "rest"


def test_the_ledger_of_a_subject_that_fails_on_its_own_level_names_its_own_error(base):
    for rung, twin_rung, faulty in (("shadow", "path", False), ("lambert", "shadow", True)):
        subject = UserRenderer("shadow", "mine", lambda _, rung=rung: trace(base, rung).mean)
        wish = msgspec.structs.replace(wanted_of(base, "numpy64"), rung="shadow", twin_rung=twin_rung, samples=1)
        (ledger,) = (event for event, _ in Session(base, subject).passes(wish) if event["kind"] == "ledger")
        parts = [row["part"] for row in ledger["parts"]]
        assert any(part.startswith("the subject's own error") for part in parts) == faulty, rung


def test_the_light_paths_of_a_pixel_bring_its_radiance_on_average(base):
    scene, n = base, 16
    for rung, depth in (("lambert", 2), ("shadow", 2), ("sky", 2), ("path", 5)):
        sampled = rung in ("sky", "path")
        image = (plain_paths(scene, depth, n, seed=0) if sampled else trace(scene, rung)).mean
        for x, y in ((60, 30), (3, 3), (40, 40)):
            ways = [light_path(scene, x, y, rung, depth, sample) for sample in range(n if sampled else 1)]
            assert np.mean([way.light for way in ways], axis=0) == pytest.approx(image[y, x], rel=1e-5), rung
            if len(ways) == 1 and len(ways[0].legs) > 1:
                assert np.sum([leg.light for leg in ways[0].legs], axis=0) == pytest.approx(image[y, x], rel=1e-5)


# ------------------------------------------------------------------------------------------ who may ask


def answer(
    server: Server, path: str, method: str = "GET", body: str | None = None, **headers: str
) -> http.client.HTTPResponse:
    link = http.client.HTTPConnection("127.0.0.1", server.port, timeout=LONG)
    link.putrequest(method, path, skip_host=True)
    for name, value in headers.items():
        link.putheader(name.replace("_", "-"), value)
    link.putheader("Content-Length", str(len(body or "")))
    link.endheaders((body or "").encode())
    response = link.getresponse()
    response.read()
    link.close()
    return response


TOKEN = "X_Raytwin_Token"
UPGRADE = {
    "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version": "13",
}  # fmt: skip


def test_only_the_own_host_is_served_and_the_token_opens_what_tells_of_the_scene(live):
    host = f"127.0.0.1:{live.port}"
    first = answer(live, "/", Host=host)
    assert first.status == 200
    assert "default-src 'none'" in first.headers["Content-Security-Policy"]
    assert "Set-Cookie" not in first.headers
    assert answer(live, "/about", Host=host, **{TOKEN: live.token}).status == 200
    for path in ("/", "/viewer.js", "/explore.js", "/about", "/scene.toml", "/socket"):
        for other in (f"localhost:{live.port}", f"{host}.evil.example", "evil.example"):
            assert answer(live, path, Host=other, **{TOKEN: live.token}).status == 403, (path, other)
    cookies = f"raytwin_{live.port}={live.token}; {TOKEN}={live.token}"
    for path in ("/about", "/scene.toml", "/socket"):
        for headers in ({}, {TOKEN: "0" * 32}, {"Cookie": cookies}, {"Authorization": live.token}):
            assert answer(live, path, Host=host, **headers).status == 403, (path, headers)
        assert answer(live, f"{path}?token={live.token}", Host=host).status == 403


def test_a_socket_or_a_saved_scene_needs_the_own_origin(live):
    host = {"Host": f"127.0.0.1:{live.port}"}
    upgrade = host | UPGRADE | {"Sec-WebSocket-Protocol": f"raytwin, {live.token}"}
    text, known = msgspec.json.encode(live.first).decode(), host | {TOKEN: live.token}
    others = "null", "http://evil.example", "http://127.0.0.1", f"https://127.0.0.1:{live.port}"
    for other in ({}, *({"Origin": origin} for origin in others)):
        assert answer(live, "/socket", **upgrade, **other).status == 403, other
        assert answer(live, "/scene.toml", "POST", text, **known, **other).status == 403, other
    socket = answer(live, "/socket", **upgrade, Origin=live.origin)
    assert (socket.status, socket.headers["Sec-WebSocket-Protocol"]) == (101, "raytwin")
    no_token = upgrade | {"Sec-WebSocket-Protocol": "raytwin"}
    assert answer(live, "/socket", **no_token, Origin=live.origin).status == 403
    assert answer(live, "/scene.toml", "POST", text, **known, Origin=live.origin).status == 200
    assert answer(live, "/scene.toml", "POST", "{", **known, Origin=live.origin).status == 400


LISTENING = """
import runpy, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
runpy.run_module("raytwin", run_name="__main__")
"""
"""What a shell starts in the background does not hear Ctrl-C, nor what that starts."""


def page_that_asks(address: str) -> socket.socket:
    """A connection that wishes for a picture, and reads nothing."""
    port, token = re.search(r":(\d+)/#token=(\w+)", address).groups()
    link = socket.create_connection(("127.0.0.1", int(port)))
    own = {"Host": f"127.0.0.1:{port}", "Origin": f"http://127.0.0.1:{port}"}
    headers = own | UPGRADE | {"Sec-WebSocket-Protocol": f"raytwin, {token}"}
    lines = "GET /socket HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items()), "", ""
    link.sendall("\r\n".join(lines).encode())
    assert b" 101 " in link.recv(1024)
    wish = json.dumps({"number": 1, "wanted": {"spheres": [{"center": [0, 0, 0.05], "radius": 0.05}]}}).encode()
    link.sendall(bytes([0x81, 0x80 | len(wish)]) + bytes(4) + wish)  # a short text as a masked frame of RFC 6455
    return link


@pytest.mark.skipif(sys.platform != "linux", reason="a browser that is a shell script")
def test_the_token_stands_on_no_command_line_and_ctrl_c_ends_a_subject_that_does_not_return(scenes, tmp_path):
    (tmp_path / "browser").write_text('#!/bin/sh\necho "$*" > line\n')
    (tmp_path / "browser").chmod(0o700)
    (tmp_path / "mine.py").write_text(
        "import time\ndef render(scene):\n    open('begun', 'w').close()\n    while True: time.sleep(1)\n"
    )
    subject = "--subject", f"{tmp_path / 'mine.py'}:render"
    command = [sys.executable, "-u", "-c", LISTENING, "explore", scenes / "overlap", "--size", "40x30", *subject]
    environment = os.environ | {"BROWSER": f"{tmp_path / 'browser'} %s"}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, env=environment, cwd=tmp_path) as run:
        try:
            said = run.stdout.readline()
            assert re.fullmatch(r"overlap at http://127\.0\.0\.1:\d+/#token=[0-9a-f]{32}\n", said)
            address = said.split()[-1]
            with page_that_asks(address):
                wait_for(lambda: (tmp_path / "line").exists() and (tmp_path / "line").read_text().endswith("\n"))
                wait_for((tmp_path / "begun").exists)
                run.send_signal(signal.SIGINT)
                out, err = run.communicate(timeout=LONG)
        finally:
            run.kill()
    assert (run.returncode, out.splitlines()[-1]) == (0, "ended"), err
    assert "Traceback" not in err
    line = (tmp_path / "line").read_text().strip()
    assert address.partition("=")[2] not in line
    assert not Path(line.removeprefix("file://")).exists()


# ------------------------------------------------------------------------------------------ in a browser


REST = "document.body.dataset.rest"


class Page:
    """The live page at rest; every request, and what stands on the console."""

    def __init__(self, page) -> None:
        self.page, self.console, self.requests = page, page.said, []
        page.on("request", lambda request: self.requests.append(request.url))

    def until(self, expression: str) -> None:
        deadline = time.monotonic() + LONG  # not `wait_for_function`, which the page's policy forbids
        while not self.page.evaluate(f"Boolean({expression})"):
            assert time.monotonic() < deadline, f"{expression}: {self.page.inner_text('#state')}"
            time.sleep(0.02)

    def viewer(self, expression: str):
        return self.page.evaluate(f"document.getElementById('viewer').viewer.{expression}")

    @contextlib.contextmanager
    def change(self):
        """Something that is rendered: waits until that has come to rest."""
        before = self.page.evaluate(REST)
        yield
        self.until(f"{REST} !== '{before}'")

    def click(self, title: str) -> None:
        with self.change():
            self.page.get_by_role("button", name=title, exact=True).first.click()

    def slide(self, label: str, value: float) -> None:
        slider = self.page.locator("#controls label", has_text=label).locator("input[type=range]").first
        with self.change():
            slider.evaluate(
                "(input, value) => { input.value = value; "
                "for (const kind of ['input', 'change']) input.dispatchEvent(new Event(kind)); }",
                value,
            )

    def drag(self, box: dict, start: tuple[float, float], end: tuple[float, float], meanwhile: str = "true") -> None:
        """From a place of a box to another, both in the page's pixels; `meanwhile` comes true before it is let go."""
        with self.change():
            self.page.mouse.move(box["x"] + start[0], box["y"] + start[1])
            self.page.mouse.down()
            self.page.mouse.move(box["x"] + end[0], box["y"] + end[1], steps=4)
            self.until(meanwhile)
            self.page.mouse.up()


@contextlib.contextmanager
def shown(chromium, address: str, ready: str = "body[data-rest]", **options) -> Iterator[Page]:
    with opened(chromium, address, **{"width": 1300, "height": 900} | options) as page:
        made = Page(page)
        page.wait_for_selector(ready)
        yield made


def middle_of(scene: Scene, name: str) -> tuple[int, int]:
    """The pixel in the middle of what is seen of an object."""
    v, u = (int(np.median(at)) for at in np.nonzero(trace(scene, "surface").surface.ids == scene.names.index(name)))
    return u, v


@pytest.fixture(scope="module")
def desk(chromium, live):
    """One page for all, found by the one that a browser is started with."""
    with opening_page(live.address) as path, shown(chromium, path.as_uri()) as page:
        assert path.parent.stat().st_mode & 0o777 == 0o700
        assert page.page.title() == "overlap · raytwin explore"
        assert page.page.url.startswith(f"{live.origin}/#view=")
        yield page


@pytest.fixture
def page(desk):
    """The page as it was first."""
    desk.click("Reset")
    desk.page.get_by_role("button", name="Whole", exact=True).first.click()  # zoomed in, a drag beside objects pans
    return desk


def test_a_link_opens_the_view_that_it_was_copied_from_where_the_token_is_known(chromium, live, page):
    page.slide("sky", 1.5)
    with shown(chromium, live.address + "&view=" + page.page.url.partition("#view=")[2]) as again:
        for one in (page, again):
            assert one.viewer("read(2, 2)")["test"][2][0] == pytest.approx(1.5, rel=1e-3)
        assert live.token not in again.page.url
        again.page.goto("about:blank")
        again.page.goto(live.origin)  # a link without the token, in a browser that was given it
        again.until(REST)
    with shown(chromium, live.origin, ready="#state.bad") as stranger:
        assert "open the address that raytwin explore printed" in stranger.page.inner_text("#state")


def test_a_sphere_is_dragged_and_the_rest_stays(page, base):
    u, v = middle_of(base, base.names[1])
    here, true = page.viewer(f"read({u}, {v})"), trace(base, "shadow").mean[v, u]
    assert here["objects"] == [base.names[1]] * 2
    assert all(abs(value - x) <= 1.01 * doubt + 1e-6 for (value, doubt), x in zip(here["test"], true, strict=True))
    box = page.page.locator("#viewer canvas").first.bounding_box()
    scale = box["width"] / SIZE[0]
    page.drag(box, ((u + 0.5) * scale, (v + 0.5) * scale), ((u + 8.5) * scale, (v + 0.5) * scale))
    wish = from_link(page.page.url)
    assert wish.spheres[0] == base.spheres[0]
    moved = np.subtract(wish.spheres[1].center, base.spheres[1].center)
    assert moved[2] == pytest.approx(0, abs=1e-9)  # over the board
    assert np.linalg.norm(moved) > 0.005
    shifted = trace(wish.scene(base), "surface").surface.ids
    after = int(np.median(np.nonzero(shifted == 1)[1]))
    assert after - u == pytest.approx(8, abs=2)
    assert page.console == []
    assert all(re.match(r"(http|ws)://127\.0\.0\.1:\d+/|data:|blob:|file:", url) for url in page.requests)


def test_zoom_is_linked_and_a_pixels_light_paths_are_drawn_and_shut_nobody_out(page):
    page.viewer("look(40, 40, 20)")
    tops = page.page.evaluate(
        "((v) => v.shown().map((p) => v.frame_of(p)).map((f) => [f.left, f.top, f.s]))"
        "(document.getElementById('viewer').viewer)"
    )
    assert all(top == pytest.approx(tops[0]) for top in tops)
    page.page.locator("#viewer canvas").first.click()
    page.until("document.getElementById('way').textContent.includes('Pixel 4')")  # a click is enough
    page.viewer("keep(40, 40)")
    page.until("document.getElementById('way').textContent.includes('Pixel 40, 40, sample 0')")  # without samples
    with page.change():
        page.page.locator(".levels").first.get_by_text("path").click()
    page.viewer("keep(50, 60)")
    page.until("document.getElementById('way').textContent.includes('8 samples')")
    assert "On average" in page.page.inner_text("#way")
    assert barriers(page.page) == []
    page.page.emulate_media(color_scheme="light")
    page.page.set_viewport_size({"width": 1300, "height": 900})
    page.page.keyboard.press("Escape")
    assert page.page.is_hidden("#way")


def test_a_drag_beside_the_objects_turns_the_camera_and_undo_takes_it_back(page, base):
    def mean(key: str) -> float:
        return page.page.evaluate(
            "(key) => { const v = document.getElementById('viewer').viewer.values[key]; let s = 0; "
            "for (const x of v) s += x; return s / v.length; }", key
        )  # fmt: skip

    first, light = page.page.url, mean("t")
    box = page.page.locator("#viewer canvas").first.bounding_box()
    page.drag(box, (6, 6), (66, 6), "document.getElementById('viewer').viewer.panes.get('map').picture")
    turned = from_link(page.page.url).scene(base).camera
    middle = np.mean([s.center for s in base.spheres], axis=0)
    old, new = (np.array(camera.eye) - middle for camera in (base.camera, turned))
    assert np.linalg.norm(new) == pytest.approx(np.linalg.norm(old))
    assert new[2] == pytest.approx(old[2])
    angle = np.degrees(np.arctan2(old[0] * new[1] - old[1] * new[0], old[:2] @ new[:2]))
    assert angle == pytest.approx(-20, abs=0.5)  # a third of a degree per pixel
    project = [np.array(c.R_cam_board) @ middle + c.t_cam_board for c in (base.camera, turned)]
    assert project[0] == pytest.approx(project[1], abs=1e-9)  # what it goes round stays where it was
    assert mean("t") != pytest.approx(light, rel=1e-3)
    with page.change():
        page.page.keyboard.press("Control+z")
    assert from_link(page.page.url).scene(base).camera == base.camera
    assert mean("t") == pytest.approx(light, rel=1e-4)
    assert from_link(first).scene(base) == from_link(page.page.url).scene(base)


def test_a_scene_that_cannot_be_rendered_is_told_in_the_page(chromium, live, base):
    """Two sheets in one place."""
    twice = (base.planes[0], msgspec.structs.replace(base.planes[0], name="another"))
    wish = msgspec.structs.replace(live.first, planes=twice)
    address = "&view=" + base64.urlsafe_b64encode(msgspec.json.encode(wish)).decode().rstrip("=")
    with shown(chromium, live.address + address, ready="#state.bad") as page:
        assert "a surface apart from all others" in page.page.inner_text("#state")
        assert page.console == []


def test_on_a_phone_controls_lie_below_the_picture_and_fingers_drag_and_zoom(chromium, live, base):
    with shown(chromium, live.address, width=390, height=844, has_touch=True) as phone:
        where = """(() => {
          const box = (found) => found.getBoundingClientRect();
          const { canvas } = document.getElementById("viewer").viewer.shown()[0];
          const labels = [...document.querySelectorAll("#controls label")];
          const sun = labels.find((label) => label.textContent.startsWith("elevation"));
          sun.scrollIntoView({ block: "nearest" });
          return [box(canvas).bottom, box(document.getElementById("controls")).top, box(sun).bottom, innerHeight];
        })()"""
        picture, sheet, slider, screen = phone.page.evaluate(where)
        assert picture <= sheet < slider < screen + 1
        phone.page.get_by_role("button", name="Controls").tap()
        assert phone.page.evaluate(where)[1] > screen - 60
        assert phone.page.evaluate("document.documentElement.scrollWidth") <= 390
        phone.page.evaluate("scrollTo(0, 0)")
        u, v = middle_of(base, base.names[1])
        canvas = phone.page.locator("#viewer canvas:visible").first
        box = canvas.bounding_box()
        x, y = (start + (at + 0.5) * box["width"] / SIZE[0] for start, at in ((box["x"], u), (box["y"], v)))
        touch = phone.page.context.new_cdp_session(phone.page)

        def send(kind: str, *points: tuple[float, float]) -> None:
            fingers = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

        tops = set()
        with phone.change():
            send("touchStart", (x, y))
            for step in range(1, 5):
                send("touchMove", (x, y + 6 * step))
                tops.add(canvas.bounding_box()["y"])
            send("touchEnd")
        moved = np.subtract(from_link(phone.page.url).spheres[1].center, base.spheres[1].center)
        assert np.linalg.norm(moved) > 0.005
        assert tops == {box["y"]} == {canvas.bounding_box()["y"]}
        assert phone.page.evaluate("scrollY") == 0
        left, top = box["x"] + 0.2 * box["width"], box["y"] + 0.2 * box["height"]  # beside all spheres
        send("touchStart", (left, top), (left + 20, top))
        send("touchMove", (left, top), (left + 40, top))
        send("touchEnd")
        assert phone.viewer("view.span") == pytest.approx(SIZE[0] / 2, rel=0.02)
        assert phone.console == []

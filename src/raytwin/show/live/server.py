"""The page on this machine's own address, and a socket to it. One worker renders, and only what was asked for last.

Any web page that the browser has open may send requests to 127.0.0.1, so that address protects nothing by itself. Here
every request must name this host and port, a socket also this origin, both compared by equality. What tells of the
scene, or renders, also needs a token of 128 bits: in a header, or among a socket's sub-protocols. The address brings
it behind its `#`, which no request carries, and the page's own storage keeps it. A cookie would not do: cookies know no
ports, so a page of another server on this machine would bring it along.
"""

import asyncio
import contextlib
import hmac
import os
import secrets
import socket
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Coroutine, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from raytwin.errors import InputError
from raytwin.rungs import RUNGS
from raytwin.scene.toml_json import plain
from raytwin.show import viewer
from raytwin.show.live.light_path import light_path
from raytwin.show.live.progressive import TWIN_EVERY, Event, Session, as_message
from raytwin.show.live.view_state import ViewRequest, from_json, scene_toml, wanted_of
from raytwin.show.page import asset, render_page
from raytwin.tracer import SOLVERS

HOST = "127.0.0.1"
MOST_BYTES = 1 << 20
"""Bytes of one message from the page."""
MOST_PATHS = 64
"""Light paths of a pixel that are drawn at once."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


TOKEN_HEADER, PROTOCOL = "X-Raytwin-Token", "raytwin"
"""A page sets the header, which no other origin may; and offers the socket's sub-protocols `raytwin` and the token."""
GRACE = 5.0
"""Seconds for which the end waits for a pass that is under way, and for connections to close."""

Send = Callable[[bytes], Coroutine[Any, Any, None]]
"""What sends a message to the page."""


class Asked(msgspec.Struct, forbid_unknown_fields=True):
    """A message from the page: a wish, the answer to what it was sent, or a pixel whose light paths it wants."""

    number: int = 0
    wanted: ViewRequest | None = None
    answered: int | None = None
    pixel: tuple[int, int] | None = None
    sample: int = 0
    paths: Annotated[int, msgspec.Meta(ge=1, le=MOST_PATHS)] = 1


class Server:
    """`await Server(session).serve()`, until it is cancelled. `address` is what the browser opens."""

    def __init__(self, session: Session, port: int = 0, first: ViewRequest | None = None) -> None:
        self.session, self.token = session, secrets.token_hex(16)
        self.first = first or wanted_of(session.base, session.engines[0])
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, os.name == "posix")
        try:
            self.socket.bind((HOST, port))
        except (OSError, OverflowError) as error:
            self.socket.close()
            raise InputError("--port", "a free one of 0 to 65535", f"{port}: {error}") from None
        self.socket.listen()
        self.socket.setblocking(False)
        self.port = self.socket.getsockname()[1]
        self.origin = f"http://{HOST}:{self.port}"
        self.worker = Worker(session)
        self.open: set[_Socket] = set()

    @property
    def address(self) -> str:
        return f"{self.origin}/#token={self.token}"

    def application(self) -> Application:
        files_ = {"/viewer.js": viewer.module, "/viewer.css": viewer.style}
        files_ |= {f"/{name}": partial(asset, name) for name in ("report.css", "charts.js")}
        own = {f"/{name}": partial(asset, f"live/{name}") for name in ("explore.js", "explore.css")}
        own |= {"/": partial(render_page, "live/explore.html.j2")}
        texts = [(path, _Text, {"server": self, "make": make}) for path, make in (files_ | own).items()]
        guarded = {"/about": _About, "/socket": _Socket, "/scene.toml": _Toml}
        pages = [(path, handler, {"server": self}) for path, handler in guarded.items()]
        return Application([*texts, *pages], websocket_max_message_size=MOST_BYTES, log_function=lambda handler: None)

    @property
    def busy(self) -> bool:
        """Whether a pass still runs: a subject's call may never return."""
        return self.worker.thread.is_alive()

    async def serve(self) -> None:
        """Serve until cancelled; then wait a little for what is under way."""
        server = HTTPServer(self.application(), max_body_size=MOST_BYTES)
        server.add_sockets([self.socket])
        self.worker.start(asyncio.get_running_loop())
        try:
            await asyncio.Event().wait()
        finally:
            self.worker.stop()
            server.stop()
            deadline = time.monotonic() + GRACE
            while self.worker.thread.is_alive() and time.monotonic() < deadline:
                await asyncio.sleep(0.01)
            for page in tuple(self.open):
                page.drop()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(server.close_all_connections(), GRACE)


@contextlib.contextmanager
def opening_page(address: str) -> Iterator[Path]:
    """A page that leads to the address, in a folder that no other user may enter.

    A browser is started with its path. A command line is everybody's to read: the token must not stand there.
    """
    with tempfile.TemporaryDirectory(prefix="raytwin-") as folder:
        page = Path(folder) / "explore.html"
        page.write_text(f'<meta http-equiv="refresh" content="0; url={address}">\n', encoding="utf-8")
        yield page


# ------------------------------------------------------------------------------------------ the worker


class Worker:
    """Renders in a thread of its own; between two passes it looks whether something else is wanted by now."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.changed = threading.Condition()
        self.wanted: tuple[int, ViewRequest] | None = None
        self.send: Send | None = None
        self.sent = self.answered = 0
        self.stopped = False

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self.thread = threading.Thread(target=self._work, name="renders", daemon=True)
        self.thread.start()

    def stop(self) -> None:
        """After the pass that is under way, which `thread.join()` waits for: no library is unloaded beneath it."""
        with self.changed:
            self.stopped = True
            self.changed.notify_all()

    def want(self, number: int, wanted: ViewRequest, send: Send) -> None:
        """Replace the current request; results go to `send`."""
        with self.changed:
            if send != self.send:
                self.sent = self.answered = 0
            self.wanted, self.send = (number, wanted), send
            self.changed.notify_all()

    def answer(self, number: int, send: Send) -> None:
        """The page has shown what it was sent as `number`."""
        with self.changed:
            if send == self.send:
                self.answered = number
            self.changed.notify_all()

    def leave(self, send: Send) -> None:
        """The page is gone."""
        with self.changed:
            if send == self.send:
                self.send = None
            self.changed.notify_all()

    def _work(self) -> None:
        done: tuple[int, ViewRequest] | None = None
        twin_at = twin_took = 0.0
        while True:
            with self.changed:
                while not self.stopped and self.wanted is done:
                    self.changed.wait()
                if self.stopped or self.wanted is None:
                    return
                done = number, wanted = self.wanted
                send = self.send
            try:
                for event in self.session.passes(wanted):
                    self._send(send, number, *event)
                    now = time.monotonic()
                    if event[0].get("pane") == "reference":
                        twin_at, twin_took = now, event[0]["seconds"]
                    due = wanted.moving and now - twin_at > TWIN_EVERY * twin_took
                    if self.stopped or (self.wanted is not done and not due):
                        break
            except InputError as error:
                self._send(send, number, {"kind": "refused", "text": str(error)}, ())
            except BaseException:  # a subject's own, or ours: the page goes on
                traceback.print_exc()
                refused = {"kind": "refused", "text": "this could not be rendered: see the terminal"}
                self._send(send, number, refused, ())

    def _send(self, send: Send | None, number: int, event: dict[str, Any], blobs: tuple[bytes, ...]) -> None:
        """Send to the page that asked, once it has answered the message before; not if it is gone, or another page
        has taken over, whose requests have numbers of their own."""
        with self.changed:
            self.changed.wait_for(lambda: self.stopped or self.send != send or self.answered >= self.sent)
            if self.stopped or send is None or self.send != send:
                return
            self.sent += 1
            sending = send(as_message({**event, "number": number, "sent": self.sent}, blobs))
        try:  # nobody waits here for a page that does not read: the next message waits for its answer to this one
            asyncio.run_coroutine_threadsafe(sending, self.loop)
        except RuntimeError:  # the loop has ended
            sending.close()


# ------------------------------------------------------------------------------------------ requests


class _Guarded(RequestHandler):
    """What every request must bring. `guarded`: the token, too."""

    guarded = True

    def initialize(self, server: Server, **_: Any) -> None:
        self.server = server

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in {
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cache-Control": "no-store",
        }.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        if self.request.headers.get_list("Host") != [f"{HOST}:{self.server.port}"]:
            raise HTTPError(403, reason="another host")
        if self.request.method != "GET" and self.request.headers.get_list("Origin") != [self.server.origin]:
            raise HTTPError(403, reason="another origin")
        if self.guarded and not any(hmac.compare_digest(t.encode(), self.server.token.encode()) for t in self.tokens()):
            raise HTTPError(403, reason="no token")

    def tokens(self) -> list[str]:
        """What the request shows as its token."""
        return self.request.headers.get_list(TOKEN_HEADER)

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")


class _About(_Guarded):
    """What the page is about: its scene, and what can render it."""

    def get(self) -> None:
        session = self.server.session
        scene = session.base
        about = {
            "scene": session.base.name, "width": scene.camera.width, "height": scene.camera.height,
            "camera": plain(scene.camera), "first": plain(self.server.first),
            "rungs": list(RUNGS),
            "engines": list(session.engines), "solvers": list(SOLVERS),
            "names": list(self.server.first.scene(session.base).names),
            "map": session.base.sky.map is not msgspec.UNSET,
            "subject": session.subject.name if session.subject else None,
        }  # fmt: skip
        self.set_header("Content-Type", "application/json")
        self.write(msgspec.json.encode(about))


class _Text(_Guarded):
    """The page, its script and its style: the same for all scenes."""

    guarded = False

    def initialize(self, server: Server, make: Callable[[], str] = str, **_: Any) -> None:
        super().initialize(server)
        self.make = make

    def get(self) -> None:
        kinds = {"js": "text/javascript", "css": "text/css"}
        kind = kinds.get(self.request.path.rpartition(".")[2], "text/html")
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write(self.make())


class _Toml(_Guarded):
    def post(self) -> None:
        try:
            wanted, base = from_json(self.request.body), self.server.session.base
            text = scene_toml(base, wanted, self.server.session.folder)
        except InputError as error:
            raise HTTPError(400, reason="no scene") from error
        self.set_header("Content-Type", "application/toml; charset=utf-8")
        self.write(text)


class _Socket(_Guarded, WebSocketHandler):
    def prepare(self) -> None:
        super().prepare()
        if self.request.headers.get_list("Origin") != [self.server.origin]:
            raise HTTPError(403, reason="another origin")

    def tokens(self) -> list[str]:
        offered = ",".join(self.request.headers.get_list("Sec-WebSocket-Protocol"))
        return [word.strip() for word in offered.split(",")]

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        return PROTOCOL if PROTOCOL in subprotocols else None

    def check_origin(self, origin: str) -> bool:
        return origin == self.server.origin

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self.last: ViewRequest | None = None
        self.server.open.add(self)

    def drop(self) -> None:
        """End the connection at once: a page that does not read takes no farewell either."""
        if self.ws_connection is not None and (stream := self.ws_connection.stream) is not None:
            stream.close()

    def on_close(self) -> None:
        self.server.open.discard(self)
        self.server.worker.leave(self.send)

    async def send(self, message: bytes) -> None:
        with contextlib.suppress(WebSocketClosedError):
            await self.write_message(message, binary=True)

    async def on_message(self, message: str | bytes) -> None:
        worker = self.server.worker
        try:
            asked = msgspec.json.decode(message, type=Asked)
            if asked.answered is not None:
                worker.answer(asked.answered, self.send)
            if asked.wanted is not None:
                self.last = asked.wanted.check()
                worker.want(asked.number, self.last, self.send)
            if asked.pixel is not None and self.last is not None:
                event, _ = await asyncio.to_thread(self.paths, self.last, asked.pixel, asked.sample, asked.paths)
                await self.send(as_message(event, ()))
        except msgspec.DecodeError as error:
            await self.send(as_message({"kind": "refused", "text": f"a message that says nothing: {error}"}, ()))
        except InputError as error:
            await self.send(as_message({"kind": "refused", "text": str(error)}, ()))

    def paths(self, wanted: ViewRequest, pixel: tuple[int, int], sample: int, count: int) -> Event:
        """Return the paths of `count` samples; one where the level has no samples."""
        scene = wanted.scene(self.server.session.base)
        x, y = (min(max(p, 0), side - 1) for p, side in zip(pixel, scene.camera.image_size, strict=True))
        some = range(sample, sample + (count if RUNGS[wanted.rung].noisy else 1))
        found = [light_path(scene, x, y, wanted.rung, wanted.depth, k) for k in some]
        ways = [way._asdict() | {"legs": [leg._asdict() for leg in way.legs]} for way in found]
        return {"kind": "way", "pixel": (x, y), "sample": sample, "ways": ways}, ()

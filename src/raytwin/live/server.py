"""The page on this machine's own address, and a socket to it. One worker renders, and only what was asked for last.

Any web page that the browser has open may send requests to 127.0.0.1, so that address protects nothing by itself. Here
every request must name this host and port, a socket also this origin, both compared by equality; and it must hold a
token of 128 bits, which the address brings once and a cookie keeps that no script reads and no other site sends.
"""

import asyncio
import contextlib
import hmac
import os
import secrets
import socket
import threading
import time
import traceback
from collections.abc import Awaitable, Callable
from importlib import resources
from typing import Any

import jinja2
import msgspec
from tornado.httpserver import HTTPServer
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from raytwin import files, viewer
from raytwin.errors import InputError
from raytwin.live.light_path import way_of_light
from raytwin.live.progressive import TWIN_EVERY, Event, Studio, told
from raytwin.live.view_state import Wanted, from_json, scene_toml, wanted_of
from raytwin.rungs import RUNGS
from raytwin.tracer import SOLVERS

HOST = "127.0.0.1"
MOST_BYTES = 1 << 20
"""Of one message from the page."""
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


Tell = Callable[[bytes], Awaitable[None]]
"""What sends a message to the page."""


class Asked(msgspec.Struct, forbid_unknown_fields=True):
    """A message from the page: a wish, the answer to what it was sent, or a pixel whose way of light it wants."""

    number: int = 0
    wanted: Wanted | None = None
    answered: int | None = None
    pixel: tuple[int, int] | None = None
    sample: int = 0


class Server:
    """`await Server(studio).serve()`, until it is cancelled. `address` is what the browser opens."""

    def __init__(self, studio: Studio, port: int = 0, first: Wanted | None = None) -> None:
        self.studio, self.token = studio, secrets.token_hex(16)
        self.first = first or wanted_of(studio.base, studio.engines[0])
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
        self.origin, self.cookie = f"http://{HOST}:{self.port}", f"raytwin_{self.port}"
        self.worker = Worker(studio)

    @property
    def address(self) -> str:
        return f"{self.origin}/?token={self.token}"

    def application(self) -> Application:
        files_ = {"/viewer.js": viewer.module, "/viewer.css": viewer.style}
        own = {f"/{name}": _own(name) for name in ("explore.js", "explore.css")}
        texts = [(path, _Text, {"server": self, "make": make}) for path, make in (files_ | own).items()]
        with_server = {"server": self}
        pages = [("/", _Page, with_server), ("/socket", _Socket, with_server), ("/scene.toml", _Toml, with_server)]
        return Application([*texts, *pages], websocket_max_message_size=MOST_BYTES, log_function=lambda handler: None)

    async def serve(self) -> None:
        server = HTTPServer(self.application(), max_body_size=MOST_BYTES)
        server.add_sockets([self.socket])
        self.worker.start(asyncio.get_running_loop())
        try:
            await asyncio.Event().wait()
        finally:
            self.worker.stop()
            server.stop()
            await asyncio.to_thread(self.worker.thread.join)
            await server.close_all_connections()


def _own(name: str) -> Callable[[], str]:
    return lambda: resources.files("raytwin.live").joinpath(name).read_text(encoding="utf-8")


# ------------------------------------------------------------------------------------------ the worker


class Worker:
    """Renders in a thread of its own; between two passes it looks whether something else is wanted by now."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.changed = threading.Condition()
        self.wanted: tuple[int, Wanted] | None = None
        self.tell: Tell | None = None
        self.sent = self.answered = 0
        self.stopped = False
        self.rendered: list[int] = []
        """The numbers of the latest wishes that were begun."""

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self.thread = threading.Thread(target=self._work, name="renders", daemon=True)
        self.thread.start()

    def stop(self) -> None:
        """After the pass that is under way, which `thread.join()` waits for: no library is unloaded beneath it."""
        with self.changed:
            self.stopped = True
            self.changed.notify_all()

    def want(self, number: int, wanted: Wanted, tell: Tell) -> None:
        """From now on this alone is rendered, and told to `tell`."""
        with self.changed:
            if tell != self.tell:
                self.sent = self.answered = 0
            self.wanted, self.tell = (number, wanted), tell
            self.changed.notify_all()

    def answer(self, number: int, tell: Tell) -> None:
        """The page has shown what it was sent as `number`."""
        with self.changed:
            if tell == self.tell:
                self.answered = number
            self.changed.notify_all()

    def leave(self, tell: Tell) -> None:
        """The page is gone."""
        with self.changed:
            if tell == self.tell:
                self.tell = None
            self.changed.notify_all()

    def _work(self) -> None:
        done: tuple[int, Wanted] | None = None
        twin_at = twin_took = 0.0
        while True:
            with self.changed:
                while not self.stopped and self.wanted is done:
                    self.changed.wait()
                if self.stopped or self.wanted is None:
                    return
                done = number, wanted = self.wanted
                tell = self.tell
                self.rendered = [*self.rendered[-99:], number]
            try:
                for event in self.studio.passes(wanted):
                    self._send(tell, number, *event)
                    now = time.monotonic()
                    if event[0].get("pane") == "reference":
                        twin_at, twin_took = now, event[0]["seconds"]
                    due = wanted.moving and now - twin_at > TWIN_EVERY * twin_took
                    if self.stopped or (self.wanted is not done and not due):
                        break
            except InputError as error:
                self._send(tell, number, {"kind": "refused", "text": str(error)}, ())
            except Exception:  # a subject's own, or ours: the page goes on
                traceback.print_exc()
                refused = {"kind": "refused", "text": "this could not be rendered: see the terminal"}
                self._send(tell, number, refused, ())

    def _send(self, tell: Tell | None, number: int, event: dict[str, Any], blobs: tuple[bytes, ...]) -> None:
        """To the page that wished for it, after its answer to the one before; not at all where it is gone, or another
        page has taken over, whose wishes have numbers of their own."""
        with self.changed:
            self.changed.wait_for(lambda: self.stopped or self.tell != tell or self.answered >= self.sent)
            if self.stopped or tell is None or self.tell != tell:
                return
            self.sent += 1
            message = told({**event, "number": number, "sent": self.sent}, blobs)
        with contextlib.suppress(RuntimeError):  # the loop has ended
            asyncio.run_coroutine_threadsafe(tell(message), self.loop).result()  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------------ requests


class _Guarded(RequestHandler):
    """What every request must bring."""

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
        if not self.knows(self.get_cookie(self.server.cookie) or ""):
            raise HTTPError(403, reason="no token")

    def knows(self, token: str) -> bool:
        return hmac.compare_digest(token.encode(), self.server.token.encode())

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code}: {self._reason}\n")


class _Page(_Guarded):
    def prepare(self) -> None:
        token = self.get_query_argument("token", "")
        if self.knows(token):
            self.request.headers["Cookie"] = f"{self.server.cookie}={token}"
            self.set_cookie(self.server.cookie, token, httponly=True, samesite="Strict", path="/")
        super().prepare()

    def get(self) -> None:
        source = resources.files("raytwin.live").joinpath("explore.html.j2").read_text(encoding="utf-8")
        studio = self.server.studio
        scene = studio.base.scene
        about = {
            "scene": studio.base.name, "width": scene.camera.width, "height": scene.camera.height,
            "camera": files.plain(scene.camera), "first": files.plain(self.server.first),
            "rungs": list(RUNGS),
            "engines": list(studio.engines), "solvers": list(SOLVERS),
            "map": studio.base.sky.map is not msgspec.UNSET,
            "subject": studio.subject.name if studio.subject else None,
        }  # fmt: skip
        page = jinja2.Environment(autoescape=True).from_string(source)
        self.write(page.render(name=studio.base.name, about=msgspec.json.encode(about).decode()))


class _Text(_Guarded):
    def initialize(self, server: Server, make: Callable[[], str] = str, **_: Any) -> None:
        super().initialize(server)
        self.make = make

    def get(self) -> None:
        kind = "text/javascript" if self.request.path.endswith(".js") else "text/css"
        self.set_header("Content-Type", f"{kind}; charset=utf-8")
        self.write(self.make())


class _Toml(_Guarded):
    def post(self) -> None:
        try:
            wanted, base = from_json(self.request.body), self.server.studio.base
            text = scene_toml(base, wanted, base.scene.camera)
        except InputError as error:
            raise HTTPError(400, reason="no scene") from error
        self.set_header("Content-Type", "application/toml; charset=utf-8")
        self.write(text)


class _Socket(_Guarded, WebSocketHandler):
    def prepare(self) -> None:
        super().prepare()
        if self.request.headers.get_list("Origin") != [self.server.origin]:
            raise HTTPError(403, reason="another origin")

    def check_origin(self, origin: str) -> bool:
        return origin == self.server.origin

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self.last: Wanted | None = None

    def on_close(self) -> None:
        self.server.worker.leave(self.tell)

    async def tell(self, message: bytes) -> None:
        with contextlib.suppress(WebSocketClosedError):
            await self.write_message(message, binary=True)

    async def on_message(self, message: str | bytes) -> None:
        worker = self.server.worker
        try:
            asked = msgspec.json.decode(message, type=Asked)
            if asked.answered is not None:
                worker.answer(asked.answered, self.tell)
            if asked.wanted is not None:
                self.last = asked.wanted.check()
                worker.want(asked.number, self.last, self.tell)
            if asked.pixel is not None and self.last is not None:
                await self.tell(told(self.way(self.last, asked.pixel, asked.sample)[0], ()))
        except msgspec.DecodeError as error:
            await self.tell(told({"kind": "refused", "text": f"a message that says nothing: {error}"}, ()))
        except InputError as error:
            await self.tell(told({"kind": "refused", "text": str(error)}, ()))

    def way(self, wanted: Wanted, pixel: tuple[int, int], sample: int) -> Event:
        scene = wanted.scene(self.server.studio.base)
        x, y = (min(max(p, 0), side - 1) for p, side in zip(pixel, scene.camera.image_size, strict=True))
        found = way_of_light(scene, x, y, wanted.rung, wanted.depth, sample)
        legs = [leg._asdict() for leg in found.legs]
        return {"kind": "way", "pixel": (x, y), "sample": sample, **found._asdict(), "legs": legs}, ()

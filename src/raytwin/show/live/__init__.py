"""A scene to play with: tracer, twin, their difference and the ledger beside them, on a page of this machine's own.

view_state.py  what the page may ask for: a scene's shapes and lights, rungs, engine, samples
progressive.py that, rendered: at once while something moves, with 1, 2, 4, ... samples when it rests
light_path.py  the light path that makes a pixel
server.py      the page, and a socket to it; one worker renders, and only what was asked for last
explore.js     the page's controls and charts around the viewer
"""

from raytwin.show.live.server import Server, opening_page
from raytwin.show.live.view_state import ViewRequest

__all__ = ["Server", "ViewRequest", "opening_page"]

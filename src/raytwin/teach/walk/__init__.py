"""The walk: a learner goes from photos to the twin in eight stages, and writes one function in each.

What a learner sees is drawn by `show/walk_cell.py`.

lessons.py.txt   the source, a script with cells (py:percent): text, empty functions, checks, pictures; no module, since
                 importing it would run the lessons
desk.py          what the lessons stand on: photos, camera, shapes, the twin
solutions.py     every function, filled in
written.py       the source as a script or a notebook, the empty functions filled where asked
"""

from raytwin.teach.walk.desk import Desk, Hits
from raytwin.teach.walk.written import with_functions, write_walk

__all__ = ["Desk", "Hits", "with_functions", "write_walk"]

"""The walk: a learner goes from photos to the twin in eight stages, and writes one function in each.

lessons.py.txt   the source, a script with cells (py:percent): text, empty functions, checks, pictures; no module, since
                 importing it would run the lessons
desk.py          what the lessons stand on: photos, camera, shapes, the twin
show.py          the picture so far, beside the twin's: a file, or the viewer in a notebook
solutions.py     every function, filled in
written.py       the source as a script or a notebook, the empty functions filled where asked
"""

from raytwin.tutorial.desk import Desk, Hits
from raytwin.tutorial.show import mine, show
from raytwin.tutorial.written import with_functions, write_walk

__all__ = ["Desk", "Hits", "mine", "show", "with_functions", "write_walk"]

"""A notebook's cell as plain Python: what IPython alone understands is taken out, and every line keeps its number."""

import ast
import re
import warnings

OTHER_LANGUAGES = frozenset({
    "bash", "sh", "script", "cmd", "html", "HTML", "javascript", "js", "latex", "markdown", "svg", "SVG", "perl",
    "ruby", "R", "cython", "writefile", "file",
})  # fmt: skip
"""Cell magics (`%%bash`) whose cells are not Python. Under any other, such as `%%time`, the cell is."""
MAX_LINES_TAKEN_OUT = 40
"""Lines taken out of a cell: each costs a parse of the whole cell."""
_FORMS = (
    (re.compile(r"(\s*)%time\s+(?=\S)(.*)"), r"\1\2"),  # runs a statement, whose names stay
    (re.compile(r"(\s*)[%!].*"), r"\1pass"),
    (re.compile(r"(\s*)(?=\S)(\?.*|.*\?)\s*"), r"\1pass"),  # help: `np.cross?`
    (re.compile(r"([\w.,\s]+=)\s*[%!].*"), r"\1 None"),  # `names = !ls`
)


def as_python(cell: str) -> str:
    """Return the cell without magics, shell commands and questions for help; "" where it is another language.

    Only lines at which Python's own parser stops are looked at: `%` within an expression or a string stays.
    """
    lines = cell.split("\n")
    first = next((line for line in lines if line.strip()), "")
    if first.startswith("%%") and first[2:].split()[:1] and first[2:].split()[0] in OTHER_LANGUAGES:
        return ""
    for _ in range(MAX_LINES_TAKEN_OUT):
        if (number := _stops_at("\n".join(lines))) is None or number >= len(lines):
            break
        line = lines[number]
        lines[number] = next((form.sub(to, line) for form, to in _FORMS if form.fullmatch(line)), line)
        if lines[number] == line:
            break
        while line.endswith("\\") and (number := number + 1) < len(lines):
            line, lines[number] = lines[number], ""
    return "\n".join(lines)


def _stops_at(text: str) -> int | None:
    """The line, from 0, at which Python's parser stops; None where it reads the text, or cannot say."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            ast.parse(text)
    except SyntaxError as error:
        return None if error.lineno is None else error.lineno - 1
    except (ValueError, RecursionError, MemoryError):
        return None
    return None

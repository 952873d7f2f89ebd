"""The names of a function, and where its values stand: what operators need to know around a node."""

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from raytwin.diagnose.edit import all_names, blocks, code, form, names_in, template

Found = Iterator[tuple[Any, ...]]
"""What an operator finds: (what was wrong, how far-fetched, what stands there instead, other parts)."""

MODULES = {"math", "cv2", "scipy", "optimize", "linalg", "itertools", "functools"}
MOST_DONORS = 24
"""Attributes and entries that may be missing beside a value."""
MOST_DIVISORS = 6
"""Divisors of a function that may be missing elsewhere in it."""


@dataclass(frozen=True)
class File:
    """What a statement's file has: its name for NumPy, the texts it reads entries by, and its own functions.

    `methods`: what is called on each name (`Rotation`: from_rotvec, from_euler); `arity`: function -> its arguments.
    """

    numpy: str = "np"
    words: tuple[str, ...] = ()
    methods: Mapping[str, frozenset[str]] = field(default_factory=dict)
    arity: Mapping[str, int] = field(default_factory=dict)
    own_words: frozenset[str] = frozenset()
    """All words of the text."""


MOST_LINES = 6
"""Lines that may be copied together."""


class Scope:
    """What a function's names are, and where its values stand."""

    def __init__(self, statement: ast.stmt, file: File, rare: bool) -> None:
        self.file, self.numpy, self.rare = file, file.numpy, rare
        self.words = file.words if rare else ()
        nodes = list(code(statement))
        called = {n.func.id for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        self.stored = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        self.stored |= {n.arg for n in nodes if isinstance(n, ast.arg)}
        self.names = sorted(self.stored - called - {"self", "_"})
        self.parents = {id(child): n for n in [statement, *nodes] for child in ast.iter_child_nodes(n)}
        self.values = {id(value) for n in nodes for value in _values(n)}
        self.steps = [n for n in nodes if isinstance(n, ast.AugAssign)]
        self.loops = {name for n in nodes if isinstance(n, ast.For) for name in names_in(n.target)} - {"_"}
        self.indices = {n.slice.id for n in nodes if isinstance(n, ast.Subscript) and isinstance(n.slice, ast.Name)}
        slices = [n.slice for n in nodes if isinstance(n, ast.Subscript) and names_in(n.slice)]
        self.parts = {ast.unparse(s): s for s in slices if any(isinstance(one, ast.Slice) for one in ast.walk(s))}
        self.counted = list({_iterated(n.iter): None for n in nodes if isinstance(n, ast.For)})
        """What the loops run over."""
        self.blocks = [block for n in [statement, *nodes] for block in blocks(n)]
        divisors = [n.right for n in nodes if isinstance(n, ast.BinOp) and isinstance(n.op, ast.Div)]
        by_text = {ast.unparse(n): n for n in divisors if not isinstance(n, ast.Constant)}
        self.divisors = list(by_text.values())[:MOST_DIVISORS]
        self.assigned: dict[str, list[ast.expr]] = {}
        self.uses: dict[str, list[ast.Name]] = {}
        self.attributes: dict[str, set[str]] = {}
        self.entries: dict[str, int] = {}
        """By what is indexed: the largest number that it is indexed by."""
        donors: list[str] = []
        for n in nodes:
            if isinstance(n, ast.Assign) and len(n.targets) == 1:
                self.assigned.setdefault(ast.unparse(n.targets[0]), []).append(n.value)
            elif isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load):
                self.uses.setdefault(n.id, []).append(n)
            elif isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name):
                if not (self.is_module(n) or self.is_called(n)):
                    self.attributes.setdefault(n.value.id, set()).add(n.attr)
                    donors.append(ast.unparse(n))
            elif isinstance(n, ast.Subscript) and isinstance(n.slice, ast.Constant):
                text, index = ast.unparse(n.value), n.slice.value
                if isinstance(index, int):
                    self.entries[text] = max(index, self.entries.get(text, 0))
                elif isinstance(index, str) and isinstance(n.value, ast.Name):
                    donors += [f"{text}[{word!r}]" for word in self.words]
        donors += sorted({ast.unparse(n) for n in nodes if isinstance(n, ast.Call) and ast.unparse(n.func) == "len"})
        self.donors = [(text, template(text)) for text in dict.fromkeys(donors)][:MOST_DONORS]
        self.unread = [name for name in self.names if name not in self.uses]
        self.lists: list[Sequence[ast.AST]] = [*self.blocks]
        self.lists += [n.elts for n in nodes if isinstance(n, ast.Tuple | ast.List)]
        self.parallel = list(_parallel(self.lists))
        self.suspects = _suspects(self.parallel)

    def is_called(self, node: ast.AST) -> bool:
        parent = self.parents.get(id(node))
        return isinstance(parent, ast.Call) and parent.func is node

    def indexed(self, node: ast.AST) -> ast.Subscript | None:
        """What the node is an index of, alone or beside others; or the entry whose array it is."""
        parent = self.parents.get(id(node))
        around = self.parents.get(id(parent)) if isinstance(parent, ast.Tuple) else parent
        return around if isinstance(around, ast.Subscript) else None

    def loops_around(self, node: ast.AST) -> Iterator[ast.For]:
        """The loops around the node, the innermost first."""
        around = self.parents.get(id(node))
        while around is not None:
            if isinstance(around, ast.For):
                yield around
            around = self.parents.get(id(around))

    def is_module(self, node: ast.AST) -> bool:
        """`np`, `np.linalg`, `cv2`: a name that is none of the function's, and what it has."""
        while isinstance(node, ast.Attribute):
            node = node.value
        return isinstance(node, ast.Name) and node.id in MODULES | {self.numpy}

    def is_leftover(self, node: ast.Name) -> bool:
        """A loop's variable, read behind the loop."""
        return node.id in self.loops and not any(node.id in names_in(one.target) for one in self.loops_around(node))


def _parallel(lists: Iterable[Sequence[ast.AST]]) -> Iterator[tuple[list[ast.AST], list[ast.AST]]]:
    """Lines, or entries of a tuple, that have the form of those before them: two runs beside each other."""
    for items in lists:
        forms = [form(one) for one in items]
        for size in range(1, 1 + min(MOST_LINES, len(items) // 2)):
            for k in range(len(items) - 2 * size + 1):
                first, second = slice(k, k + size), slice(k + size, k + 2 * size)
                if forms[first] == forms[second]:
                    yield list(items[first]), list(items[second])


def _suspects(pairs: Iterable[tuple[list[ast.AST], list[ast.AST]]]) -> dict[int, set[str]]:
    """Where a copied line was not changed throughout: id of a name -> what stands there elsewhere for its counterpart.

    After `x = (u - cx) * a + u * b` stands `y = (v - cy) * a + u * b`: of the two `u` one became `v`.
    """
    found: dict[int, set[str]] = {}
    for pair in pairs:
        for one, other in (pair, pair[::-1]):
            names = [[n for part in run for n in all_names(part)] for run in (one, other)]
            images: dict[str, set[str]] = {}
            for a, b in zip(*names, strict=True):
                images.setdefault(a.id, set()).add(b.id)
            for a, b in zip(*names, strict=True):
                found.setdefault(id(b), set()).update(images[a.id] - {b.id})
    return found


def _iterated(node: ast.expr) -> str:
    """What a loop runs over, without `enumerate`, `range(len(` and `zip` around it."""
    while isinstance(node, ast.Call) and node.args:
        node = node.args[0]
    return ast.unparse(node)


def _values(n: ast.AST) -> list[ast.expr]:
    """Return the values that a node computes with: operands, arguments, what is assigned or returned."""
    some: list[ast.expr | None] = []
    if isinstance(n, ast.BinOp):
        some = [n.left, n.right]
    elif isinstance(n, ast.Call):
        some = [*n.args, n.func.value if isinstance(n.func, ast.Attribute) else None]
    elif isinstance(n, ast.Assign | ast.AugAssign | ast.Return):
        some = [n.value]
    elif isinstance(n, ast.Tuple | ast.List) and isinstance(n.ctx, ast.Load):
        some = [*n.elts]
    elif isinstance(n, ast.Compare):
        some = [n.left, *n.comparators]
    return [one for one in some if one is not None and not isinstance(one, ast.Starred)]

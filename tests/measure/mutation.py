"""Change a room's code in random places, one at a time, and count the changes that its tests notice.

    python -m measure.mutation ROOM... [--count 8] [--seed 1] [--seconds 600]

A room is a folder of src/raytwin, or `.` for the files beside them. Run it in a clone of its own: the source is changed
in place, and put back. Each change is a line of JSON: whether `default` tests noticed it, `nightly` ones, or `nothing`.
The room's test files run, those that name the changed function or its module first.
Each file runs unchanged first: one that fails is left out.
"""

import argparse
import ast
import copy
import functools
import json
import os
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
SOURCE, TESTS = ROOT / "src" / "raytwin", ROOT / "tests"
COMPARED = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
ARITHMETIC = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Pow: ast.Mult, ast.Mod: ast.Add, ast.MatMult: ast.Mult,
}  # fmt: skip
NO_MEANING = {"strict", "encoding", "help", "kw_only", "frozen", "ensure_ascii", "indent", "stacklevel", "check"}
"""Arguments that change no number: they are not dropped."""


class Change(NamedTuple):
    path: Path
    function: str
    node: ast.AST
    kind: str
    text: str


def changed(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    """Yield each small change of one node."""
    made = copy.deepcopy(node)
    match made:
        case ast.Compare(ops=[op]) if type(op) in COMPARED:
            made.ops = [COMPARED[type(op)]()]
            yield "comparison", made
        case ast.BinOp(left=left, right=right) if not isinstance(left, ast.Constant | ast.JoinedStr) or not isinstance(
            right, ast.Constant | ast.JoinedStr | ast.Tuple
        ):
            if type(made.op) in ARITHMETIC:
                made.op = ARITHMETIC[type(made.op)]()
                yield "arithmetic", made
        case ast.Constant(value=bool() as value):
            yield "constant", ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield "constant", ast.Constant(value + 1 if isinstance(value, int) else value * 2 or 1.0)
        case ast.Call(keywords=keywords):
            for i, word in enumerate(keywords):
                if word.arg and word.arg not in NO_MEANING:
                    less = copy.deepcopy(made)
                    del less.keywords[i]
                    yield f"argument {word.arg} dropped", less
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand) if not isinstance(operand, ast.Constant):
            yield "sign", operand
        case ast.If() | ast.IfExp() | ast.While() if not isinstance(made.test, ast.Compare | ast.BoolOp):
            yield "condition", ast.UnaryOp(ast.Not(), made.test)
        case (
            ast.Expr(value=ast.Call())
            | ast.AugAssign()
            | ast.Raise()
            | ast.Assign(targets=[ast.Attribute() | ast.Subscript()])
        ):
            yield "statement dropped", ast.Pass()


def skipped(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the parts of a node whose changes say nothing: annotations, messages, imports, decorators."""
    match node:
        case ast.FunctionDef(args=args, returns=returns, decorator_list=decorators):
            every = [*args.posonlyargs, *args.args, *args.kwonlyargs]
            yield from (part for part in (*decorators, returns, *(a.annotation for a in every)) if part)
        case ast.AnnAssign(annotation=annotation):
            yield annotation
        case ast.Raise(exc=exc) if exc:
            yield exc
        case ast.JoinedStr() | ast.Assert():
            yield node
        case ast.ClassDef(decorator_list=decorators, bases=bases, keywords=keywords):
            yield from (*decorators, *bases, *keywords)


def changes(path: Path) -> list[Change]:
    """Return every change of a file, with the innermost named function round it."""
    text, found = path.read_text(encoding="utf-8"), []

    def walk(node: ast.AST, function: str) -> None:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            function = node.name if not node.name.startswith("__") else function
        leave = set(map(id, skipped(node)))
        if id(node) in leave:
            return
        for kind, new in changed(node) if function else ():
            place = node.test if kind == "condition" else node
            found.append(Change(path, function, place, kind, ast.unparse(new)))
        for child in ast.iter_child_nodes(node):
            if id(child) not in leave:
                walk(child, function)

    walk(ast.parse(text), "")
    return found


def applied(text: str, change: Change) -> str:
    """Return the source with the change in it."""
    lines, node = text.encode().splitlines(keepends=True), change.node
    start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    new = change.text if isinstance(node, ast.stmt | ast.Constant) else f"({change.text})"
    return (text.encode()[:start] + new.encode() + text.encode()[end:]).decode()


def tests_of(change: Change) -> list[list[Path]]:
    """Return the room's test files: those that name the function or its module most often, then the others."""
    room = change.path.parent.relative_to(SOURCE).parts
    room = room if TESTS.joinpath(*room).is_dir() else room[:1]
    near = sorted(TESTS.joinpath(*room).glob("**/test_*.py" if room else "test_*.py"))
    named = re.compile(rf"\b{change.function}\b|{change.path.stem}")
    count = {p: len(named.findall(p.name + p.read_text(encoding="utf-8"))) for p in near}
    close = sorted((p for p in near if count[p]), key=lambda p: -count[p])[:3]
    return [close, [p for p in near if p not in close]]


@functools.cache
def passes(path: Path, marks: str, seconds: float) -> bool:
    """Return whether a test file passes while nothing is changed: one that fails anyway notices nothing."""
    try:
        return noticed([path], marks, seconds) is None
    except subprocess.TimeoutExpired:
        return False


def noticed(files: list[Path], marks: str, seconds: float) -> str | None:
    """Return the test that fails first, if one does; raise TimeoutExpired where they come to no end."""
    if not files:
        return None
    # A folder of its own: a change may leave in it what no later run of pytest could remove.
    folder = tempfile.mkdtemp()
    options = ["-x", "-q", "-n0", "--tb=no", "-p", "no:cacheprovider", "-m", marks, "--basetemp", f"{folder}/tests"]
    call = [sys.executable, "-m", "pytest", *options, *map(str, files)]
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, timeout=seconds, env=environment)
    finally:
        subprocess.run(["rm", "-rf", folder], check=False)
    failed = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.M)
    if failed or done.returncode in (0, 5):
        return failed[0] if failed else None
    if done.returncode < 0:
        return f"ended by signal {-done.returncode}"
    raise SystemExit(f"the tests did not run: {done.stdout[-2000:]}{done.stderr[-2000:]}")


def tried(change: Change, seconds: float) -> tuple[str, str | None]:
    """Return what noticed the change (`undecided`: the tests came to no end in time), and the first test that did."""
    text, times = change.path.read_text(encoding="utf-8"), change.path.stat()
    asked = [(marks, files) for marks in ("not nightly", "nightly") for files in tests_of(change)]
    try:
        for marks, files in asked:
            change.path.write_text(text, encoding="utf-8")
            sound = [path for path in files if passes(path, marks, seconds)]
            change.path.write_text(applied(text, change), encoding="utf-8")
            if test := noticed(sound, marks, seconds):
                return marks.replace("not nightly", "default"), test
        return "nothing", None
    except subprocess.TimeoutExpired:
        return "undecided", f"no end within {seconds:g} s"
    finally:
        change.path.write_text(text, encoding="utf-8")
        os.utime(change.path, ns=(times.st_atime_ns, times.st_mtime_ns))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("room", nargs="+")
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=600)
    asked = parser.parse_args()
    for room in asked.room:
        files = sorted((SOURCE / room).glob("*.py" if room == "." else "**/*.py"))
        places = [c for path in files for c in changes(path)]
        rng = random.Random(f"{asked.seed} {room}")
        rng.shuffle(places)
        # Of each kind as many, and of a function one: most places are constants and long functions.
        kinds = sorted({c.kind.split()[0] for c in places})
        picked: dict[tuple[Path, str], Change] = {}
        for i in range(asked.count):
            kind = kinds[(i + rng.randrange(len(kinds))) % len(kinds)]
            fresh = [c for c in places if c.kind.split()[0] == kind and (c.path, c.function) not in picked]
            picked |= {(c.path, c.function): c for c in fresh[:1]}
        for change in picked.values():
            by, test = tried(change, asked.seconds)
            before = ast.unparse(change.node).splitlines()[0]
            where = f"{change.path.relative_to(SOURCE)}:{change.node.lineno}"
            row = {"room": room, "noticed": by, "where": where, "function": change.function, "kind": change.kind}
            row |= {"before": before[:120], "after": change.text.splitlines()[0][:120], "test": test}
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()

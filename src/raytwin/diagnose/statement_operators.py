"""Slips of whole statements: lines too many, lost, moved or in the wrong loop; conditions, jumps, functions."""

import ast
import itertools
from collections.abc import Iterator

from raytwin.diagnose.edit import Edit, all_names, changed, fill, form, names_in, renamed, short, template
from raytwin.diagnose.expression_operators import OTHER_SIGN
from raytwin.diagnose.scope import Found, Scope

SHARED = "an array is changed in place"
"""What may be wrong in a function that is right where its arguments are nobody else's."""
BETWEEN_CALLS = "results are kept between calls"
TOO_MANY = "this line is too many"
REPLACED = "each time replaces the one before"
MOST_NAMES = 6
"""Names of an expression, up to which two of them are swapped."""
SIMPLE = ast.Assign | ast.AugAssign | ast.Expr


def _assigned(target: ast.expr, value: ast.expr) -> ast.Assign:
    return ast.Assign([changed(target, ctx=ast.Store())], value)


def assign(n: ast.Assign, scope: Scope) -> Found:
    target = n.targets[0]
    if len(n.targets) != 1:
        return
    for divisor in scope.divisors:
        words = f"the divisor `{short(divisor)}` is missing"
        yield words, 1.4, changed(n, value=fill("A / B", A=n.value, B=divisor))
    yield TOO_MANY, 2.0, [ast.Pass()]
    used = sorted(names_in(n.value).intersection(scope.names))
    for one, two in itertools.combinations(used, 2) if len(used) <= MOST_NAMES else ():
        yield f"`{one}` and `{two}` are swapped", 1.5, changed(n, value=renamed(n.value, {one: two, two: one}))
    for other in scope.assigned.get(ast.unparse(target), ()):
        if other is not n.value:
            yield "elsewhere it is computed otherwise", 1.6, changed(n, value=other)
    if isinstance(target, ast.Subscript) and ast.unparse(target.slice) in (":", "..."):
        yield SHARED, 0.95, _assigned(target.value, n.value)
    if isinstance(target, ast.Name | ast.Subscript):
        in_loop = next(scope.loops_around(n), None) is not None
        for op in (ast.Add(), ast.BitAnd(), ast.BitOr(), ast.Mult(), ast.Sub())[: 5 if in_loop else 1]:
            yield REPLACED, 1.1, ast.AugAssign(target, op, n.value)
        for least in ("minimum", "maximum") if in_loop else ():
            value = fill(f"NP.{least}(A, B)", A=changed(target, ctx=ast.Load()), B=n.value, NP=template(scope.numpy))
            yield REPLACED, 1.1, changed(n, value=value)


def copied(n: ast.Assign, scope: Scope) -> Found:
    """What is a copy, and should be none; or is none, and should be one."""
    target = n.targets[0]
    if isinstance(target, ast.Subscript) and isinstance(inner := target.value, ast.Subscript):
        place = changed(inner, slice=fill("A[B]", A=inner.slice, B=target.slice))
        yield "a copy of the entries is changed, not the array", 0.9, _assigned(place, n.value)
    if isinstance(n.value, ast.Call) and any(k.arg == "out" for k in n.value.keywords):
        rest = [k for k in n.value.keywords if k.arg != "out"]
        yield SHARED, 0.75, changed(n, value=changed(n.value, keywords=rest))
    if isinstance(n.value, ast.Tuple) and all(isinstance(one, ast.Name) for one in n.value.elts):
        copies = [fill("A.copy()", A=one) for one in n.value.elts]
        yield "a copy is missing", 0.9, changed(n, value=changed(n.value, elts=copies))


def augmented(n: ast.AugAssign, scope: Scope) -> Found:
    if isinstance(n.target, ast.Name):
        yield SHARED, 0.75, ast.Assign([n.target], ast.BinOp(changed(n.target, ctx=ast.Load()), n.op, n.value))
    yield TOO_MANY, 1.7, [ast.Pass()]
    if type(n.op) in OTHER_SIGN:
        words, other = OTHER_SIGN[type(n.op)]
        yield words, 1.0, changed(n, op=other())
    yield "it is added up, not replaced", 1.6, ast.Assign([n.target], n.value)


def expression(n: ast.Expr, scope: Scope) -> Found:
    one = n.value
    if isinstance(one, ast.Compare) and isinstance(one.ops[0], ast.Eq):
        yield "`==` stands for `=`", 0.8, _assigned(one.left, one.comparators[0])
    if isinstance(one, ast.Call):
        named = [one.func.value] if isinstance(one.func, ast.Attribute) and not scope.is_module(one.func) else one.args
        if named and isinstance(named[0], ast.Name):
            yield "what it returns is not used", 1.1, _assigned(named[0], one)
    yield TOO_MANY, 1.7, [ast.Pass()]


def condition(n: ast.If, scope: Scope) -> Found:
    yield "the condition is the wrong way round", 1.1, changed(n, test=ast.UnaryOp(ast.Not(), n.test))
    yield "the condition is too many", 1.5, list(n.body)
    yield "the condition never holds", 1.5, list(n.orelse) or [ast.Pass()]
    if n.orelse:
        yield "the two cases are swapped", 1.1, changed(n, body=n.orelse, orelse=n.body)
        yield "the other case is too many", 1.3, changed(n, orelse=[])
    if len(n.body) > 1:
        yield "the last line belongs behind the condition", 1.5, [changed(n, body=n.body[:-1]), n.body[-1]]
    if any(isinstance(one, ast.In | ast.NotIn) for one in ast.walk(n.test)):
        yield BETWEEN_CALLS, 0.9, list(n.body)


def loop(n: ast.For | ast.While, scope: Scope) -> Found:
    *others, last = n.body
    if isinstance(last, ast.Return):
        words = "the return is one level too deep: it ends the loop"
        yield words, 0.8, [changed(n, body=others or [ast.Pass()]), last]
    for step in scope.steps:
        if step not in n.body:
            yield f"`{short(step)}` is missing in the loop", 2.2, changed(n, body=[*n.body, step])
    if others:
        yield "the last line belongs behind the loop", 2.0, [changed(n, body=others), last]
        for one in [s for s in n.body[:3] if isinstance(s, SIMPLE)]:
            yield "the line belongs before the loop", 1.5, [one, changed(n, body=[s for s in n.body if s is not one])]


def jump(n: ast.stmt, scope: Scope) -> Found:
    yield "it ends too early", 1.2, [ast.Pass()]
    other = ast.Continue() if isinstance(n, ast.Break) else ast.Break()
    yield f"`{ast.unparse(other)}` is wanted", 1.0, [other]


def function(n: ast.FunctionDef, scope: Scope) -> Found:
    """What a function keeps from one call to the next: a default value that is changed, a cache around it."""
    defaults = n.args.defaults
    for argument, default in zip(n.args.args[len(n.args.args) - len(defaults) :], defaults, strict=True):
        if isinstance(default, ast.List | ast.Dict | ast.Set | ast.Call):
            first = ast.copy_location(_assigned(template(argument.arg), default), n.body[0])
            yield "the default value is kept between calls", 1.3, [changed(n, body=[first, *n.body])]
    if not isinstance(n.body[-1], ast.Return) and n.name != "__init__":
        for name in sorted(names_in(n, ast.Store)):
            last = ast.copy_location(ast.Return(template(name)), n.body[-1])
            yield f"`return {name}` is missing", 1.2, [changed(n, body=[*n.body, last])]
    if n.decorator_list:
        yield BETWEEN_CALLS, 1.5, [changed(n, decorator_list=[])]


def late_variable(n: ast.Lambda, scope: Scope) -> Found:
    """A function made in a loop, which reads the loop's variable when it is called: by then, the last one."""
    named = {name for loop in scope.loops_around(n) for name in names_in(loop, ast.Store)}
    if late := sorted((names_in(n.body) & named) - {argument.arg for argument in n.args.args}):
        more, values = [ast.arg(name) for name in late], [template(name) for name in late]
        own = changed(n.args, args=n.args.args + more, defaults=n.args.defaults + values)
        words = "the loop's variable is read when the function is called, not when it is made"
        yield words, 0.8, changed(n, args=own)


# ------------------------------------------------------------------------------------------ blocks


def in_block(block: list[ast.stmt], scope: Scope) -> Iterator[Edit]:
    """Slips of lines beside one another."""
    yield from _moved(block)
    yield from _companion(block, scope)
    if not scope.rare:
        yield from _lost(block, scope)


def _moved(block: list[ast.stmt]) -> Iterator[Edit]:
    """A statement that belongs elsewhere: into the loop behind it, into the one before it, behind its neighbour."""
    into = "the line belongs into the loop"
    for k, (one, after) in enumerate(itertools.pairwise(block)):
        if isinstance(one, SIMPLE) and isinstance(after, SIMPLE):
            yield Edit("two lines are in the wrong order", 1.3, one, [changed(after)], ((after, [changed(one)]),))
        for later in block[k + 1 : k + 5] if isinstance(one, ast.Assign) else ():
            if later is not after or not isinstance(after, SIMPLE):
                yield Edit("the line comes too early", 1.6, one, [ast.Pass()], ((later, [later, one]),))
        if isinstance(one, ast.For | ast.While) and isinstance(after, SIMPLE):
            yield Edit(into, 1.7, after, [ast.Pass()], ((one.body[-1], [one.body[-1], after]),))
        if isinstance(after, ast.For | ast.While):
            for before in [s for s in block[max(0, k - 5) : k + 1] if isinstance(s, SIMPLE)]:
                for first in [n.body[0] for n in ast.walk(after) if isinstance(n, ast.For | ast.While)]:
                    yield Edit(into, 1.4, first, [before, first], moved=before)
        if isinstance(one, ast.Return):
            yield Edit("it returns too early", 0.9, one, [ast.Pass()])


def _lost(block: list[ast.stmt], scope: Scope) -> Iterator[Edit]:
    """A line that a block of the same kind has, in this one's names.

    What is missing is mostly written elsewhere in the text (Barr and others, The plastic surgery hypothesis, 2014).
    """
    forms = _forms(block)
    seen = set(map(ast.unparse, block))
    here = frozenset(seen)
    for other in scope.blocks:
        theirs = _forms(other)
        if other is block or not ({*forms, *_targets(block)} & {*theirs, *_targets(other)}):
            continue
        names = _counterparts(other, block, scope)
        for (a, p), (b, q) in itertools.product(zip(other, theirs, strict=True), zip(block, forms, strict=True)):
            if p == q and len(all_names(a)) > 2 and ast.unparse(a) not in here:
                names |= {x.id: y.id for x, y in zip(all_names(a), all_names(b), strict=True) if x.id != y.id}
        for k, one in enumerate(other):
            line = renamed(one, names) if ast.unparse(one) not in here else one
            text = ast.unparse(line)
            if not isinstance(one, SIMPLE) or text in seen:
                continue
            seen.add(text)
            behind = [mine for f in theirs[k + 1 :] for mine, form in zip(block, forms, strict=True) if f == form]
            before = [mine for f in theirs[:k] for mine, form in zip(block, forms, strict=True) if f == form]
            at = [*behind[:1], *before[-1:], block[0]][0]
            first = bool(behind or not before)
            yield Edit(f"`{short(line)}` is missing", 1.2, at, [line, at] if first else [at, line])


def _forms(block: list[ast.stmt]) -> list[str]:
    """The form of each simple statement."""
    return [form(one) if isinstance(one, SIMPLE) else repr(id(one)) for one in block]


def _targets(block: list[ast.stmt]) -> list[str]:
    return [ast.unparse(one.targets[0]) for one in block if isinstance(one, ast.Assign)]


def _counterparts(theirs: list[ast.stmt], mine: list[ast.stmt], scope: Scope) -> dict[str, str]:
    """The variables of the loop around one block in place of those around another."""
    one, other = (next(scope.loops_around(block[0]), None) for block in (theirs, mine))
    pairs = zip(all_names(one.target), all_names(other.target), strict=False) if one and other else ()
    return {a.id: b.id for a, b in pairs if a.id != b.id}


def _companion(block: list[ast.stmt], scope: Scope) -> Iterator[Edit]:
    """A line like one that is there, for another name: as a rule where two entries are exchanged."""
    for one in block:
        exchanged = isinstance(one, ast.Assign) and isinstance(one.targets[0], ast.Tuple)
        for base in _changed_in_place(one) if scope.rare != exchanged else ():
            for name in scope.names:
                if name != base:
                    like = renamed(one, {base: name})
                    yield Edit(f"`{short(like)}` is missing", 0.9 if exchanged else 2.1, one, [one, like])


def _changed_in_place(one: ast.stmt) -> set[str]:
    """The names of arrays and values that a line changes."""
    if not isinstance(one, ast.Assign | ast.AugAssign):
        return set()
    target = one.target if isinstance(one, ast.AugAssign) else one.targets[0]
    stored = next(n for n in ast.walk(target) if isinstance(n, ast.Subscript | ast.Name))
    names = {n.id for n in all_names(stored)[:1]}
    return names & names_in(one.value) if isinstance(one, ast.Assign) else names

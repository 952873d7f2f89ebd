"""Changes of a text that are run: what a function returns with each, in the sandbox or in this process.

The text of these functions is sent into the sandbox: each imports what it needs itself.
"""

from typing import Any


def remembering(space: Any, name: Any) -> Any:
    """The function of that name, which is asked once for the same arguments, unless it changes them."""
    import pickle

    kept, right = space.setdefault("raytwin_kept", {}), space[name]

    def remembered(*args: Any, **named: Any) -> Any:
        try:
            key = name, pickle.dumps((args, named))
        except Exception:  # of classes that are made anew
            return right(*args, **named)
        if key not in kept:
            if len(kept) > 50:
                kept.clear()
            got = right(*args, **named)
            try:
                if pickle.dumps((args, named)) != key[1]:
                    return got
                kept[key] = pickle.dumps(got)
            except Exception:
                return got
        return pickle.loads(kept[key])

    return remembered


def slow_functions(space: Any, call: Any) -> Any:
    """Name -> (function that remembers, names that it reads in turn) of functions that take long in this call."""
    import contextlib
    import dis
    import time
    import types

    spent: dict[str, list[float]] = {}

    def timed(name: Any, function: Any) -> Any:
        def measured(*args: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*args, **named)
            finally:
                spent.setdefault(name, []).append(time.perf_counter() - began)

        return measured

    def codes(thing: Any) -> Any:
        some = vars(thing).values() if isinstance(thing, type) else [thing]
        todo = [one.__code__ for one in some if isinstance(one, types.FunctionType)]
        for code in todo:
            todo += [one for one in code.co_consts if isinstance(one, types.CodeType)]
        return todo

    def reads(name: Any) -> Any:
        """None if it changes global names."""
        found, todo = {name}, [name]
        for one in todo:
            for code in codes(space.get(one)):
                if dis.opmap["STORE_GLOBAL"] in code.co_code[::2]:
                    return None
                todo += [n for n in code.co_names if n not in found]
                found.update(code.co_names)
        return found

    functions = {
        name: one for name, one in space.items() if isinstance(one, types.FunctionType) and one.__globals__ is space
    }
    space.update({name: timed(name, one) for name, one in functions.items()})
    with contextlib.suppress(TimeoutError):
        call()
    space.update(functions)
    slow = {name: reads(name) for name, some in spent.items() if sum(some) / len(some) > 3e-4}
    return {name: (remembering(space, name), names) for name, names in slow.items() if names is not None}


def unchanged(space: Any, slow: Any, bound: Any) -> Any:
    """Those of the `slow` functions that do without names that are bound anew, and without what their classes have."""
    classes = [space[name] for name in bound if isinstance(space.get(name), type)]
    methods = {name for one in classes for name in vars(one) if callable(vars(one)[name])}
    if any(name.startswith("__") and name not in ("__init__", "__repr__") for name in methods):
        return {}  # operators of values are not called by name
    return {name: keep for name, (keep, reads) in slow.items() if not reads & {*bound, *methods}}


def attempt(
    space: Any, function: Any, codes: Any, names: Any, settings: Any, arguments: Any, seconds: Any,
    changed: Any = False, innocent: Any = (),
) -> Any:  # fmt: skip
    """What the function returns with each of `codes` run in `space`, the switch being set; names are put back after.

    A list of arrays or None: it raised, it took too long, or, if `changed`, it returns what it does without.
    What `innocent` functions return is kept.
    """
    import contextlib
    import io
    import pickle
    import signal
    import threading
    import time
    import warnings

    import numpy

    def stop(number: Any, frame: Any) -> None:
        raise TimeoutError

    def answer(limit: float, code: Any, setting: Any) -> Any:
        try:
            if timed:
                signal.setitimer(signal.ITIMER_VIRTUAL, limit)
            space["raytwin_switch"] = dict(map(tuple, setting))
            for one in code:
                exec(one, space)
            got = space[function](*pickle.loads(stored))
            return tuple(numpy.array(a, dtype=float) for a in (got if isinstance(got, tuple) else (got,)))
        except (Exception, SystemExit):  # a change that does not run is none
            return None
        finally:
            if timed:
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)

    def said(arrays: Any) -> Any:
        return None if arrays is None else [(a.shape, a.tobytes()) for a in arrays]

    stored = pickle.dumps(arguments)
    timed = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    before_it = signal.signal(signal.SIGVTALRM, stop) if timed else None
    made = []
    slow = space.setdefault("raytwin_slow", {})
    rights = {name: space[name] for name in innocent if name in space}
    space.update({name: remembering(space, name) for name in rights})
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), numpy.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        began = time.process_time()
        as_it_is = said(answer(seconds, (), ()))
        if as_it_is is not None:
            seconds = min(seconds, 0.1 + 10 * (time.process_time() - began))
        if codes and function not in slow:
            slow[function] = slow_functions(space, lambda: answer(seconds, (), ()))
        for code, bound, setting in zip(codes, names, settings, strict=True):
            old = {name: space[name] for name in bound if name in space}
            keeping = unchanged(space, slow[function], bound)
            old |= {name: space[name] for name in keeping}
            space.update(keeping)
            got = None
            with contextlib.suppress(TimeoutError):  # the clock may ring on the way out, too
                got = answer(seconds, code, setting)
            space.update(old)
            made.append(None if changed and said(got) == as_it_is else got)
    space.update(rights)
    if timed:
        signal.signal(signal.SIGVTALRM, before_it)
    return made


def places_reached(space: Any, function: Any, codes: Any, names: Any, arguments: Any, seconds: Any) -> Any:
    """The places of the switch that one call asks for, with all codes run in `space` and nothing changed."""

    class Asked(dict):
        def __contains__(self, place: object) -> bool:
            asked.add(place)
            return False

    asked: set[object] = set()
    call_with_all(space, function, codes, names, Asked(), arguments, seconds)
    return sorted(asked)


def call_with_all(
    space: Any, function: Any, codes: Any, names: Any, switch: Any, arguments: Any, seconds: Any
) -> None:  # fmt: skip
    """Call the function once, with all codes run in `space` and this switch; names are put back after."""
    old = {name: space[name] for bound in names for name in bound if name in space}

    def call(*args: Any) -> Any:
        space["raytwin_switch"] = switch
        for one in (one for code in codes for one in code):
            exec(one, space)
        return space[function](*args)

    space["raytwin_call"] = call
    attempt(space, "raytwin_call", [], [], [], arguments, seconds)
    space.update(old)


def print_of(value: Any) -> Any:
    """Equal for equal values, to 12 digits; None where it cannot be told."""
    import numpy

    if isinstance(value, tuple | list):
        parts = [print_of(one) for one in value]
        return None if None in parts else (type(value), *parts)
    if value is None or isinstance(value, str | range | slice):
        return type(value), repr(value)
    if not isinstance(value, int | float | numpy.generic | numpy.ndarray):
        return None
    array = numpy.asarray(value)
    if array.dtype.kind == "f":
        digits, power = numpy.frexp(array)
        digits = numpy.where(numpy.isnan(digits), numpy.nan, numpy.round(digits, 12) + 0.0)
        return array.dtype.str, array.shape, digits.tobytes(), power.tobytes()
    return (array.dtype.str, array.shape, array.tobytes()) if array.dtype.kind in "biu" else None


def local_values(
    space: Any, function: Any, codes: Any, names: Any, settings: Any, arguments: Any, seconds: Any
) -> Any:  # fmt: skip
    """Rows (place, number, group, whole) of one call with all `codes` run in `space`.

    `group`: -1: the change raises; 0: it changes no value; else the number, from 1, of the first change that gives the
    same values. `whole`: 1 where each time was looked at, 0 where some were.
    """
    import time

    prints: dict[int, list[list[Any]]] = {}
    times: dict[int, int] = {}
    busy, until = [False], time.process_time() + seconds

    def print_with(other: Any) -> Any:
        try:
            return print_of(other())
        except TimeoutError:
            raise
        except Exception:
            return "raised"

    def values(place: int, own: Any, others: Any) -> Any:
        value = own()
        times[place] = n = times.get(place, 0) + 1
        # Of many times the 1st, 2nd, 3rd, 4th, 6th, 8th, 12th, 16th, 24th ...: loops begin with what is special.
        if not busy[0] and n // (n & -n) in (1, 3) and time.process_time() < until:
            busy[0] = True
            prints.setdefault(place, []).append([print_of(value), *map(print_with, others())])
            busy[0] = False
        return value

    space["raytwin_values"] = values
    switch = dict(tuple(pair) for setting in settings for pair in setting)
    call_with_all(space, function, codes, names, switch, arguments, 2 * seconds)
    rows = []
    for place, seen in prints.items():
        first: dict[Any, int] = {}
        for number, each in enumerate(zip(*seen, strict=True)):
            group = number if None in each else first.setdefault(each, number)
            group = -1 if "raised" in each else group
            rows.append((place, number - 1, group, int(len(seen) == times[place])))
    return rows

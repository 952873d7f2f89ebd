"""Run edited versions of a function, and return what each gives, in the sandbox or in this process.

The text of these functions is sent into the sandbox: each imports what it needs itself.
"""

from typing import Any


def remembering(space: Any, name: Any) -> Any:
    """Cache the function of that name by its arguments; never for calls that modify them."""
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


def attempt(
    space: Any, function: Any, codes: Any, names: Any, arguments: Any, seconds: Any, changed: Any = False,
    innocent: Any = (),
) -> Any:  # fmt: skip
    """What the function returns with each of `codes` run in `space`; the `names` that it binds are put back after.

    A list of arrays or None: it raised, it took too long, it changed its arguments, or, if `changed`, it returns what
    it does without. `innocent` are functions known to be correct, whose results are cached.
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

    def answer(limit: float, code: Any) -> Any:
        try:
            if timed:
                signal.setitimer(signal.ITIMER_VIRTUAL, limit)
            if code is not None:
                exec(code, space)
            given = pickle.loads(stored)
            before = [pickle.dumps(one) for one in given if not isinstance(one, dict)]
            got = space[function](*given)
            if before != [pickle.dumps(one) for one in given if not isinstance(one, dict)]:
                return None
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
    correct = {name: space[name] for name in innocent if name in space}
    space.update({name: remembering(space, name) for name in correct})
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings(), numpy.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        began = time.process_time()
        as_it_is = said(answer(seconds, None))
        if as_it_is is not None:
            seconds = min(seconds, 0.1 + 10 * (time.process_time() - began))
        for code, bound in zip(codes, names, strict=True):
            old = {name: space[name] for name in bound if name in space}
            got = None
            with contextlib.suppress(TimeoutError):  # the clock may ring on the way out, too
                got = answer(seconds, code)
            space.update(old)
            made.append(None if changed and said(got) == as_it_is else got)
    space.update(correct)
    if timed:
        signal.signal(signal.SIGVTALRM, before_it)
    return made


def lines_run(space: Any, function: Any, arguments: Any, seconds: Any) -> Any:
    """(name of the outermost function or class, line) -> how often one call runs that line of the text."""
    import sys
    import threading

    count: dict[tuple[str, int], int] = {}

    def in_frame(frame: Any, event: Any, argument: Any) -> Any:
        if event == "line":
            place = frame.f_code.co_qualname.partition(".")[0], frame.f_lineno
            count[place] = count.get(place, 0) + 1
        return in_frame

    def called(frame: Any, event: Any, argument: Any) -> Any:
        return in_frame if frame.f_globals is space else None

    def traced(*arguments: Any) -> Any:
        threading.settrace(called)
        sys.settrace(called)
        try:
            return space[function](*arguments)
        finally:
            sys.settrace(None)
            threading.settrace(None)

    before_it = sys.gettrace()
    space["raytwin_traced"] = traced
    attempt(space, "raytwin_traced", [], [], arguments, seconds)
    sys.settrace(before_it)
    return count

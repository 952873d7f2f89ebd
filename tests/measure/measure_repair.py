"""How often a slip in a student's text is repaired, and its line named.

python -m measure.measure_repair    in tests/
"""

import time
import types

from measure import record
from starter_submissions import RIGHT, SLIPS

from raytwin.contract.check_function import judge_function, repair_function
from raytwin.contract.stage_table import CONTRACT


def module(source):
    made = types.ModuleType("submission")
    exec(compile(source, "submission.py", "exec"), made.__dict__)
    return made


def main():
    repaired = right_line = blamed = shown = 0
    spent = []
    for slip in SLIPS:
        made, begun = module(slip.source), time.process_time()
        wrong = [s for s in CONTRACT.values() if hasattr(made, s.name)
                 and not judge_function(s, getattr(made, s.name)).passed]  # fmt: skip
        if not wrong:
            print(f"{slip.label}: not shown")
            continue
        shown += 1
        begun = time.process_time()
        function = getattr(made, wrong[0].name)
        result = judge_function(wrong[0], function)
        begun = time.process_time()
        found = repair_function(wrong[0], function, source=slip.source)
        spent.append(time.process_time() - begun)
        line = found.line if found else None
        repaired += found is not None
        right_line += line == slip.line
        told = f"{found.hint(3)} ({found.tried} tried)" if found else result.sentence[:90]
        print(f"{slip.label} ({spent[-1]:.1f} s): {result.causes} line {line} of {slip.line}: {told}", flush=True)
    for text, old, new in RIGHT:
        made = module(text.replace(old, new) if old else text)
        blamed += any(
            not judge_function(s, getattr(made, s.name)).passed for s in CONTRACT.values() if hasattr(made, s.name)
        )
    rows = [
        ["slips", len(SLIPS)],
        ["that a check notices", shown],
        ["repaired", repaired],
        ["with the right line named", right_line],
        ["right ones blamed", f"{blamed} of {len(RIGHT)}"],
        ["CPU seconds per repair", f"{sum(spent) / len(spent):.2f}, at most {max(spent):.1f}"],
    ]
    record.table("causes", "repair", ["", "count"], rows, "python -m measure.measure_repair")


if __name__ == "__main__":
    main()

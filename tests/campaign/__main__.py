"""`python tests/campaign [PART ...] [--short] [--seed N]`: faults on purpose, and what came of them.

Parts: kills, damage, arguments, stages, drags, threads; all unless given. Ends with 1 if anything is wrong.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path[0] = str(Path(__file__).parents[1])

from campaign import damage, inputs, kills, threads  # noqa: E402
from campaign.processes import Processes, may_trace  # noqa: E402


def count(pairs: object) -> tuple[int, list[str]]:
    """How many were tried, and the complaints."""
    done, complaints = 0, []
    for moment, complaint in pairs:
        done += 1
        if complaint:
            complaints.append(f"{moment}: {complaint}")
    return done, complaints


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--short", action="store_true", help="a twentieth of it")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    part = 20 if options.short else 1
    folder = Path(tempfile.mkdtemp(prefix="faults"))
    wrong = False
    with Processes(("worm", "rope", "chain")) as processes:

        def killed() -> tuple[int, list[str]]:
            if not may_trace():
                return 0, ["strace is not installed, or may not attach here"]
            results = [count(kills.check(processes, case, folder / "k", part)) for case in kills.CASES]
            return sum(done for done, _ in results), [c for _, complaints in results for c in complaints]

        def damaged() -> tuple[int, list[str]]:
            figures, complaints = damage.check(processes, folder / "damage", 20_000 // part, options.seed)
            return figures["damages"], [*complaints]

        def threaded() -> tuple[int, list[str]]:
            return 8 * (100 // part), threads.check(8, 100 // part)

        def mutated(check: Callable, times: int) -> Callable[[], tuple[int, list[str]]]:
            return lambda: count(check(processes, folder / "inputs", times // part, options.seed))

        parts = {
            "kills": ("kills, each then gone on from", killed),
            "damage": ("checkpoints with a byte changed", damaged),
            "arguments": ("argument lists", mutated(inputs.check_arguments, 1000)),
            "stages": ("stages", mutated(inputs.check_stages, 1000)),
            "drags": ("recordings of drags", mutated(inputs.check_drags, 500)),
            "threads": ("simulations in 8 threads", threaded),
        }
        if unknown := set(options.parts) - set(parts):
            parser.error(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(parts)}")
        for name in options.parts or parts:
            what, run = parts[name]
            begin = time.monotonic()
            done, complaints = run()
            print(f"{done:6} {what}: {len(complaints)} wrong ({time.monotonic() - begin:.0f} s)", flush=True)
            for complaint in complaints[:50]:
                print(f"       {complaint[:300]}", flush=True)
            wrong |= bool(complaints)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())

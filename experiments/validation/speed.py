"""Speed on one core, as ratios to what a user would choose instead, all measured in one run.

``python -m inkjet_env.experiments.validation.speed`` prints the tables of `simulator_speed` and `plant_speed`, and the
share of the core's arithmetic that the fastest kernel reaches, and writes them to a record. Records of different days
and machines can be compared by their ratios: ``python -m inkjet_env.experiments.publish.speed_tables FOLDER``."""

from __future__ import annotations

import argparse
import datetime
import os
import platform
from pathlib import Path
from typing import Any

from inkjet_env.experiments.execution.provenance import versions
from inkjet_env.experiments.validation import arithmetic, plant_speed, simulator_speed
from inkjet_env.printhead import Printhead
from inkjet_env.storage import write_json

FORMAT = "speed/1"
SIMULATOR = (
    ("Hysteresis", "ns a sample", simulator_speed.hysteresis_table),
    ("Cost of a waveform", "µs a waveform", simulator_speed.evaluations_table),
    ("Environments", "µs a step", simulator_speed.environments_table),
)


def processor() -> str:
    """Name of the processor, as far as the system tells it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def measured() -> dict[str, Any]:
    """The record: every table, printed as it is measured."""
    tables: list[dict[str, Any]] = []
    for title, unit, table in SIMULATOR:
        print(f"\n{title}")
        rows = table()
        for name, value, ratio in rows:
            print(f"  {name:58s} {value:12.2f} {unit:14s} {ratio:9.2f} ×")
        tables.append({"title": title, "unit": unit, "rows": [list(row) for row in rows]})
    return {"tables": [*tables, *plant_tables()], "arithmetic": floor_of(tables[1]["rows"])}


def floor_of(rows: list[Any]) -> dict[str, float]:
    """How far the kernel of lanes is from what the core's arithmetic allows."""
    needed = arithmetic.operations(simulator_speed.drawn_waveforms(), Printhead.published())
    possible = arithmetic.operations_a_second()
    found = {
        "operations": needed,
        "operations_a_second": possible,
        "floor_us": 1e6 * needed / possible,
        "taken_us": next(value for name, value, _ in rows if "lanes" in name),
    }
    share = found["floor_us"] / found["taken_us"]
    print(
        f"\nA waveform in lanes needs {needed:,.0f} operations; a core does {1e-9 * possible:.1f} thousand million a "
        f"second, so the floor is {found['floor_us']:.3f} µs: {100 * share:.0f} % of it is reached"
    )
    return found


def plant_tables() -> list[dict[str, Any]]:
    """The plant against SciPy's integrators, and the cost of effects."""
    head = Printhead.published()
    print(f"\nA cubic spring, {plant_speed.SAMPLES} samples, from rest, against solve_ivp at the same accuracy")
    against = []
    for other in plant_speed.baselines(head):
        print(
            f"  {other.method:6s} rtol {other.rtol:.0e}  error {other.error:.1e} {1e3 * other.seconds:7.2f} ms"
            f"   plant: error {other.plant_error:.1e}  {1e3 * other.plant_seconds:.3f} ms   {other.ratio:7.0f} ×"
        )
        against.append([f"solve_ivp, {other.method}", 1e3 * other.seconds, other.ratio])
    print("\nThe whole plant, in steady state under a repeated pulse")
    effects = plant_speed.costs(head)
    for name, ns in effects.items():
        print(f"  {name:20s} {ns:8.0f} ns a sample")
    return [
        {"title": "A cubic spring, at the accuracy of the plant", "unit": "ms", "rows": against},
        {
            "title": "The whole plant, with an effect",
            "unit": "ns a sample",
            "rows": [[name, ns, ns / effects["base"]] for name, ns in effects.items()],
        },
    ]


def main(arguments: list[str] | None = None) -> None:
    """Print the tables and write the record."""
    parser = argparse.ArgumentParser(prog="python -m inkjet_env.experiments.validation.speed", description=__doc__)
    parser.add_argument("--record", type=Path, default=Path("results/speed.json"), metavar="FILE")
    record = parser.parse_args(arguments).record
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    simulator_speed.register_idle()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"On one core: {processor()}")
    about = {
        "format": FORMAT,
        "date": datetime.datetime.now(tz=datetime.UTC).date().isoformat(),
        "processor": processor(),
        "versions": versions(),
    }
    found = about | measured()
    record.parent.mkdir(parents=True, exist_ok=True)
    write_json(record, found)
    print(f"\nRecord: {record}")


if __name__ == "__main__":
    main()

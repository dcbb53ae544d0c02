"""Benches of several people, checked and ranked together: their runs are read, none is repeated.

Every run is checked as if it were one's own: its costs are simulated anew, so that only the order in which an optimiser
asked has to be believed. Nothing that a folder names is imported: optimisers need not be installed, and only problems
of the suite count. Runs must be equally long; of more repeats than another bench has, the first ones count.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from inkjet_env.experiments.benchmark.entrants import Entrant, entrants
from inkjet_env.experiments.benchmark.regret import best_known_cost
from inkjet_env.experiments.benchmark.run_files import RunKey, RunResult, label_of, read_run, run_path
from inkjet_env.experiments.benchmark.settings import BENCH_FORMAT, BenchOutcome, BenchSettings
from inkjet_env.experiments.benchmark.suite import suite
from inkjet_env.experiments.execution.provenance import first_difference
from inkjet_env.storage import stored_object

MERGED_FORMAT = "bench-merged/1"
NAME = re.compile(r"[\w.:+-]{1,100}")
"""What the name of an optimiser may be: part of the names of files."""
AT = "@"
"""Stands between the name of an optimiser and that of the bench it comes from, where another bench has the name too."""


@dataclass(frozen=True)
class Source:
    """The bench of somebody, as its folder tells.

    Parameters
    ----------
    name : str
        Name of the folder.
    folder : Path
        The folder.
    settings : mapping
        Content of ``bench.json``.
    problems : tuple of str
        Names of its problems that are of the suite.
    """

    name: str
    folder: Path
    settings: Mapping[str, Any]
    problems: tuple[str, ...]

    @classmethod
    def of(cls, folder: Path) -> Source:
        """The bench in a folder.

        Raises
        ------
        ValueError
            The folder holds none, or one of another version, or a problem of it is another one here.
        """
        file = folder / "bench.json"
        try:
            settings = stored_object(file)
            wrong = first_difference(settings.get("format"), BENCH_FORMAT)
            names = [*map(str, settings["optimizers"])]
            problems = {str(name): dict(of) for name, of in settings["problems"].items() if name in suite()}
            counts = int(settings["budget"]), int(settings["repeats"]), int(settings["seed"])
            for optimizer in names:
                label_of(RunKey(optimizer, next(iter(settings["problems"])), 0), settings)
            found = cls(folder.resolve().name, folder, settings, tuple(problems))
            found.provenance()
        except (OSError, ValueError, KeyError, TypeError, AttributeError, StopIteration) as error:
            why = str(error)[:120] or type(error).__name__
            raise ValueError(f"{folder} is not the results folder of a bench ({why}). Give another folder.") from None
        if strange := [one for one in names if not NAME.fullmatch(one)]:
            raise ValueError(f"{file}: {strange[0]!r} is not a name of an optimiser. Correct it there.")
        if wrong or not names or min(counts[:2]) < 1:
            raise ValueError(f"{file} is not of a bench of this version ({wrong or 'it is empty'}). Bench anew.")
        for name, of in problems.items():
            if difference := first_difference(of, suite()[name].settings(), f"problem {name}"):
                raise ValueError(f"{folder}: its problem {name} is another one than here: {difference}.")
        return found

    def runs(self, problems: Sequence[str], repeats: int) -> list[RunResult]:
        """Its runs of these problems, each checked.

        Raises
        ------
        DamagedResultError
            A file is not what a bench writes for its run: its costs are not those of its waveforms, for instance.
        ValueError
            Runs of an optimiser are missing.
        """
        found = []
        for optimizer in self.settings["optimizers"]:
            for name in problems:
                keys = [RunKey(optimizer, name, repeat) for repeat in range(repeats)]
                there = [key for key in keys if run_path(self.folder, key).exists()]
                if there and len(there) < len(keys):
                    raise ValueError(
                        f"{self.folder}: {len(keys) - len(there)} of {len(keys)} runs of {optimizer} on {name} are "
                        "missing. Finish that bench first."
                    )
                found += [read_run(self.folder, key, label_of(key, self.settings)) for key in there]
        return found

    def provenance(self) -> dict[str, Any]:
        """What its runs depend on, and a digest of their files, as plain JSON values."""
        total = sha256()
        for file in sorted((self.folder / "runs").glob("*.parquet")):
            total.update(f"{file.name}\0{sha256(file.read_bytes()).hexdigest()}\0".encode())
        told = {name: self.settings[name] for name in ("optimizers", "seed", "repeats")}
        told["versions"] = dict(self.settings["versions"])
        of_others = {
            str(name): {part: str(one.get(part, "none")) for part in ("place", "package", "code")}
            for name, one in self.settings.get("plugins", {}).items()
        }
        code = str(self.settings["code"])
        return {"name": self.name, **told, "code": code, "plugins": of_others, "runs": total.hexdigest()}


@dataclass(frozen=True)
class MergedSettings(BenchSettings):
    """Settings of a comparison that is made of several benches.

    Parameters
    ----------
    sources : tuple of Source
        The benches.
    of_optimizer : mapping
        The bench of each optimiser, and its name there.
    """

    sources: tuple[Source, ...] = ()
    of_optimizer: Mapping[str, tuple[Source, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.problems:
            best_known_cost(name)

    def budget_of(self, optimizer: str) -> int:
        """Number of evaluations of a run of that optimiser."""
        source, name = self.of_optimizer[optimizer]
        return int(source.settings.get("shorter", {}).get(name, source.settings["budget"]))

    def entrant(self, name: str) -> Entrant:
        """The entrant as its bench tells; an optimiser that is not known here has no remark."""
        source, there = self.of_optimizer[name]
        options = source.settings.get("options", {}).get(there, {})
        return Entrant(name, there.removesuffix("-tuned") if there in entrants() else there, options)

    def uses_gradient(self, name: str) -> bool:
        """Whether an optimiser that is known here uses gradients; of another one it is not known."""
        _, there = self.of_optimizer[name]
        return there in entrants() and super().uses_gradient(there)

    def to_json(self) -> dict[str, Any]:
        """Everything that determines the results, as plain JSON values."""
        return {
            "format": MERGED_FORMAT,
            "budget": self.budget,
            "repeats": self.repeats,
            "seed": self.seed,
            "optimizers": list(self.optimizers),
            "problems": {name: suite()[name].settings() for name in self.problems},
            "sources": self.sources_json(),
        }

    def sources_json(self) -> list[dict[str, Any]]:
        """What each bench depends on, as plain JSON values."""
        return [source.provenance() for source in self.sources]


def merged(folders: Sequence[Path], out: Path) -> BenchOutcome:
    """The comparison of all optimisers of several benches on the problems that all of them have.

    An optimiser that two benches have keeps its name in the first; in another one it is ``name@folder``, so that it can
    be seen whether both had the same one.

    Parameters
    ----------
    folders : sequence of Path
        Results folders of finished benches.
    out : Path
        Folder for the report; made if missing.

    Raises
    ------
    ValueError
        A folder holds no bench, or one whose runs are longer or shorter, or none of the problems of the others.
    DamagedResultError
        A run is not what a bench writes.
    """
    if (out / "bench.json").exists():
        raise ValueError(f"{out} holds a bench of its own. Give another folder for the comparison of several.")
    sources = [Source.of(folder) for folder in folders]
    first = sources[0]
    for source in sources[1:]:
        if source.settings["budget"] != first.settings["budget"]:
            raise ValueError(
                f"runs must be equally long: {first.folder} has {first.settings['budget']} evaluations, "
                f"{source.folder} has {source.settings['budget']}. Bench one of them anew."
            )
    problems = tuple(name for name in first.problems if all(name in source.problems for source in sources))
    if not problems:
        raise ValueError(
            f"{', '.join(str(source.folder) for source in sources)} have no problem of the suite in common."
        )
    repeats = min(int(source.settings["repeats"]) for source in sources)
    of_optimizer: dict[str, tuple[Source, str]] = {}
    results: list[RunResult] = []
    for source in sources:
        runs = source.runs(problems, repeats)
        names = {}
        for optimizer in dict.fromkeys(run.key.optimizer for run in runs):
            names[optimizer] = optimizer if optimizer not in of_optimizer else f"{optimizer}{AT}{source.name}"
            if names[optimizer] in of_optimizer:
                raise ValueError(f"two folders are called {source.name}. Rename one of them.")
            of_optimizer[names[optimizer]] = source, optimizer
        results += [replace(run, key=replace(run.key, optimizer=names[run.key.optimizer])) for run in runs]
    settings = MergedSettings(
        problems, tuple(of_optimizer), repeats, int(first.settings["budget"]), int(first.settings["seed"]),
        tuple(sources), of_optimizer,
    )  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    return BenchOutcome(settings, out, results, {})

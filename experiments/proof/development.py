"""Diagnoses of a development corpus in the open, to develop the diagnosis and to calibrate its probabilities.

``python -m inkjet_env.experiments.proof.development FOLDER [--seed N] [--first K] [--workers N]``

Nothing is blind here, so no proof may use the same seed: that of the published proof is refused. Of each kind of case
(family, effects, strength, size) the first K of the corpus are diagnosed, by default one. FOLDER gets a JSON file a
case, with ``draw``, ``truth`` and ``answer`` as a judged proof has them; a case whose file is there is not done again.
`inkjet_env.experiments.publish.calibrate_probabilities` reads such a folder.
"""

from __future__ import annotations

import argparse
import multiprocessing
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from inkjet_env.experiments.concealed_plant import RIG
from inkjet_env.experiments.proof.campaign_files import unpack
from inkjet_env.experiments.proof.chosen_cases import first_of_each_kind
from inkjet_env.experiments.proof.concealment import conceal, families
from inkjet_env.experiments.proof.corpus import DEVELOPMENT_SEED, PUBLISHED_SEED, Draw, corpus
from inkjet_env.experiments.proof.sealing import read_json
from inkjet_env.progress import shown_progress
from inkjet_env.storage import write_json


def diagnosed(draw: Draw, folder: Path) -> dict[str, Any]:
    """Draw, truth and answer of one case, read from the folder if they are there; otherwise diagnosed and written."""
    from inkjet_env.mismatch import diagnose
    from inkjet_env.recordings import read_campaign

    file = folder / f"{draw.number:04d}.json"
    if not file.exists():
        made = conceal(draw, f"development-{draw.number}", RIG)
        with tempfile.TemporaryDirectory(prefix="inkjet-development-") as scratch:
            unpack(made.packed, Path(scratch) / "campaign")
            verdict = diagnose(read_campaign(Path(scratch) / "campaign"), rng=0, workers=1).as_json()
        write_json(file, {"draw": draw.as_json(), "truth": made.truth, "answer": {"verdict": verdict}})
    case: dict[str, Any] = read_json(file)
    return case


def read_answers(folder: Path) -> list[dict[str, Any]]:
    """All cases of a folder, in the order of their numbers."""
    return [read_json(file) for file in sorted(folder.glob("[0-9]*.json"))]


def main(arguments: Sequence[str] | None = None) -> None:
    """Diagnose and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the answers")
    parser.add_argument("--seed", type=int, default=DEVELOPMENT_SEED, help="seed of the corpus")
    parser.add_argument("--first", type=int, default=1, help="cases of each kind")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    asked = parser.parse_args(arguments)
    if asked.seed == PUBLISHED_SEED:
        parser.error(
            f"--seed: {PUBLISHED_SEED} is that of the published proof, which must stay unseen. Choose another."
        )
    asked.folder.mkdir(parents=True, exist_ok=True)
    draws = first_of_each_kind(corpus(asked.seed, "full", *families(RIG)), asked.first)
    with ProcessPoolExecutor(asked.workers, multiprocessing.get_context("spawn")) as pool:
        answers = [pool.submit(diagnosed, draw, asked.folder) for draw in draws]
        try:
            with shown_progress("Diagnosing in the open", len(draws)) as progress:
                for done, (draw, answer) in enumerate(zip(draws, answers, strict=True), start=1):
                    verdict = answer.result()["answer"]["verdict"]
                    named = [effect["id"] for effect in verdict["effects"]]
                    about = (draw.number, draw.family, *draw.effects, draw.strength, draw.noise)
                    print(*about, verdict["verdict"], *named)
                    progress(done)
        finally:  # an interrupt does not wait for cases that have not begun
            pool.shutdown(cancel_futures=True)


if __name__ == "__main__":
    main()

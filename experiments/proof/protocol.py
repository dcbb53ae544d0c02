"""The proof from end to end: conceal, seal, diagnose blind, commit, unseal, judge; each step resumes if stopped."""

from __future__ import annotations

import functools
import json
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

from inkjet_env.experiments.execution.cluster import run_each
from inkjet_env.experiments.execution.provenance import code_digest
from inkjet_env.experiments.proof.blind_run import diagnose_blind
from inkjet_env.experiments.proof.campaign_files import ProofError, digest, pack, unpack
from inkjet_env.experiments.proof.chosen_cases import chosen_cases
from inkjet_env.experiments.proof.concealment import conceal, families
from inkjet_env.experiments.proof.corpus import Draw, corpus, opaque_name
from inkjet_env.experiments.proof.sealing import (
    JUDGE_SOURCES,
    SOURCES,
    Settings,
    answer_file,
    check_answer,
    commit_answers,
    open_folder,
    read_answer,
    read_json,
    salt_of,
    seal,
    unseal,
    verified_manifest,
)
from inkjet_env.progress import shown_progress
from inkjet_env.storage import UNFINISHED, json_text, write_atomically

JUDGED_FORMAT = "proof-judged/1"


@dataclass(frozen=True)
class Steps:
    """The functions that workers apply to a case; workers must be able to import their modules.

    Attributes
    ----------
    conceal : callable
        (draw as JSON, name, rig, code digest) → campaign's bytes, its digest, truth, attempt.
    answer : callable
        (name, campaign's bytes, its digest, code digest) → answer.
    judge : callable
        (case as sealed, answer, campaign's bytes, questions, rig, code digest) → judgement.
    """

    conceal: Callable[..., Any]
    answer: Callable[..., Any]
    judge: Callable[..., Any]


@dataclass(frozen=True)
class Outcome:
    """A finished proof.

    Attributes
    ----------
    folder : Path
        Folder of the proof.
    manifest, answers : dict
        The two commitments: to truth and campaigns, and to the answers.
    cases : list of dict
        Name, draw, truth, answer, run and judgement of each case, in the order of the case numbers.
    judge : dict, optional
        Code and versions that judged, if not the present ones.
    """

    folder: Path
    manifest: Mapping[str, Any]
    answers: Mapping[str, Any]
    cases: list[dict[str, Any]]
    judge: Mapping[str, Any] | None = None


def conceal_case(draw: Mapping[str, Any], name: str, rig: str, code: str) -> tuple[bytes, str, Mapping[str, Any], int]:
    """Conceal one case at a worker, with `concealment.conceal`."""
    _check_code("rig", SOURCES["rig"], code)
    made = conceal(Draw.from_json(dict(draw)), name, rig)
    return made.packed, made.digest, made.truth, made.attempt


def answer_case(name: str, packed: bytes, sealed_digest: str, code: str) -> dict[str, Any]:
    """Answer one campaign at a worker, with `blind_run.diagnose_blind`."""
    _check_code("finder", SOURCES["finder"], code)
    return diagnose_blind(name, packed, sealed_digest)


def _check_code(part: str, patterns: tuple[str, ...], expected: str) -> None:
    if code_digest(patterns) != expected:
        raise ProofError(
            f"the code of the {part} differs, here or at a worker, from that with which this proof was started. "
            "Restore it on all machines, restart the workers and repeat the command, or start again in another folder."
        )


def prove(
    settings: Settings, folder: Path, client: Any, steps: Steps, asked: Callable[[Sequence[Draw]], Mapping[int, Any]]
) -> Outcome:
    """Do all steps whose results ``folder`` does not hold yet.

    Parameters
    ----------
    settings : Settings
        Seed, profile and rig.
    folder : Path
        Folder of the proof; created if missing.
    client : distributed.Client
        Client of the cluster that does the work.
    steps : Steps
        Functions that the workers apply to a case.
    asked : callable
        Maps the list of all draws to additional questions for the judge by case number.

    Raises
    ------
    ProofError
        A violation that would invalidate the result; see `sealing`.
    """
    whole = corpus(settings.seed, settings.profile, *families(settings.rig, settings.published))
    draws = chosen_cases(whole, settings.only, settings.first)
    open_folder(folder, settings)
    code = read_json(folder / "proof.json")["code"]
    salt = salt_of(folder)
    named = dict(sorted(((opaque_name(salt, draw), draw) for draw in draws), key=itemgetter(0)))
    _conceal_all(folder, named, settings.rig, client, steps, code["rig"])
    cases = {name: read_json(folder / "sealed" / "cases" / f"{name}.json") for name in named}
    manifest = seal(folder, cases)
    _say(f"Sealed: SHA-256 of salt and truth is {manifest['truth_sha256']}.")
    _answer_all(folder, manifest, client, steps, code["finder"])
    committed = commit_answers(folder, manifest)
    _say(f"Committed: SHA-256 of all answers is {committed['answers_sha256']}.")
    truth = unseal(folder, verified_manifest(folder))
    _say("Unsealed: the truth is the one that was sealed.")
    judged = _judge_all(folder, truth, client, steps, asked(draws), settings.rig)
    return _outcome(folder, manifest, committed, truth, judged)


def as_judged(folder: Path) -> Outcome:
    """A judged proof as stored, after its commitments have been checked; its campaigns may be absent.

    Raises
    ------
    ProofError
        A judgement or score.json is missing, or answers or truth are not those that were committed to.
    """
    manifest = read_json(folder / "manifest.json")
    committed, truth = commit_answers(folder, manifest), unseal(folder, manifest)
    judged = {name: read_json(folder / "judged" / f"{name}.json")["judged"] for name in truth}
    judge = read_json(folder / "score.json")["judge"]
    return replace(_outcome(folder, manifest, committed, truth, judged), judge=judge)


def _outcome(
    folder: Path,
    manifest: Mapping[str, Any],
    committed: Mapping[str, Any],
    truth: Mapping[str, Mapping[str, Any]],
    judged: Mapping[str, Any],
) -> Outcome:
    cases = []
    for name, case in truth.items():
        entry = read_answer(folder, name)
        cases.append({"name": name, **case, "answer": entry["answer"], "run": entry["run"], "judged": judged[name]})
    return Outcome(folder, manifest, committed, sorted(cases, key=lambda case: case["draw"]["number"]))


def _say(sentence: str) -> None:
    print(sentence, file=sys.stderr, flush=True)


def _conceal_all(folder: Path, named: Mapping[str, Draw], rig: str, client: Any, steps: Steps, code: str) -> None:
    """Record every case that is not recorded yet; the file with its truth is written last.

    A campaign that was removed is recorded again and must be identical byte for byte.
    """

    def truth_file(name: str) -> Path:
        return folder / "sealed" / "cases" / f"{name}.json"

    jobs = {
        name: functools.partial(lambda n, d: (d.as_json(), n, rig, code), name, draw)
        for name, draw in named.items()
        if not (truth_file(name).exists() and (folder / "campaigns" / name).exists())
    }
    with shown_progress("conceal", len(named), len(named) - len(jobs)) as progress:
        done = len(named) - len(jobs)

        def keep(name: str, made: tuple[bytes, str, Mapping[str, Any], int]) -> None:
            nonlocal done
            packed, campaign, truth, attempt = made
            case = {"draw": named[name].as_json(), "attempt": attempt, "campaign": campaign, "truth": truth}
            if truth_file(name).exists() and read_json(truth_file(name))["campaign"] != campaign:
                raise ProofError(
                    f"{name} differs from its earlier recording: on this machine the rig computes other numbers. "
                    f"Restore {folder / 'campaigns'}, resume on the original machine, or start again."
                )
            place = folder / "campaigns" / name
            unfinished = place.with_name(f"{name}{UNFINISHED}")
            unpack(packed, unfinished)
            if place.exists():  # written by a run that was stopped before it wrote the truth
                shutil.rmtree(place)
            unfinished.rename(place)
            if not truth_file(name).exists():
                write_atomically(truth_file(name), json_text(case))
            done += 1
            progress(done, name)

        run_each(client, steps.conceal, jobs, keep)


def _answer_all(folder: Path, manifest: Mapping[str, Any], client: Any, steps: Steps, code: str) -> None:
    """Diagnose every campaign that has no answer yet, in the order of the opaque names."""
    campaigns: Mapping[str, str] = manifest["campaigns"]

    def job(name: str) -> tuple[Any, ...]:
        place = folder / "campaigns" / name
        if digest(place) != campaigns[name]:
            raise ProofError(f"{place} was changed after it was sealed. Restore the original, or start again.")
        return name, pack(place), campaigns[name], code

    jobs = {name: functools.partial(job, name) for name in campaigns if not answer_file(folder, name).exists()}
    done = len(campaigns) - len(jobs)
    if done and jobs:
        _say(f"{done} of {len(campaigns)} answers are finished already; resuming.")
    with shown_progress("diagnose blind", len(campaigns), done) as progress:

        def keep(name: str, entry: dict[str, Any]) -> None:
            nonlocal done
            check_answer(folder, entry, manifest)
            write_atomically(answer_file(folder, name), json_text(entry))
            done += 1
            progress(done, f"{name}: {_in_short(entry['answer'])}")

        run_each(client, steps.answer, jobs, keep)


def _in_short(answer: Mapping[str, Any]) -> str:
    if answer["verdict"] is None:
        return str(answer["status"])
    ids = "+".join(effect["id"] for effect in answer["verdict"]["effects"])
    return f"{answer['verdict']['verdict']} {ids}".strip()


def _judge_all(
    folder: Path,
    truth: Mapping[str, Mapping[str, Any]],
    client: Any,
    steps: Steps,
    asked: Mapping[int, Any],
    rig: str,
) -> dict[str, Any]:
    """Judge every answer that this code has not judged yet on these questions."""
    code = code_digest(JUDGE_SOURCES)
    questions = {name: asked[case["draw"]["number"]] for name, case in truth.items()}
    judged: dict[str, Any] = {}
    for name in truth:
        file = folder / "judged" / f"{name}.json"
        if file.exists():
            entry = read_json(file)
            if (entry.get("code"), entry.get("asked")) == (code, json.loads(json_text(questions[name]))):
                judged[name] = entry["judged"]

    def job(name: str) -> tuple[Any, ...]:
        answer = read_answer(folder, name)["answer"]
        return truth[name], answer, pack(folder / "campaigns" / name), questions[name], rig, code

    jobs = {name: functools.partial(job, name) for name in truth if name not in judged}
    with shown_progress("judge", len(truth), len(judged)) as progress:

        def keep(name: str, found: dict[str, Any]) -> None:
            judged[name] = found
            entry = {"format": JUDGED_FORMAT, "code": code, "asked": questions[name], "judged": found}
            write_atomically(folder / "judged" / f"{name}.json", json_text(entry))
            progress(len(judged), name)

        run_each(client, steps.judge, jobs, keep)
    return judged

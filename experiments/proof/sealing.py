"""Files of a proof in its folder, in order: settings, sealed truth, campaigns, answers; each step checks the previous.

``proof.json``      settings: version, seed, profile, code; written first
``sealed/``         salt, what each case conceals, and all of it in ``truth.json``: for the judge only
``campaigns/``      one folder per case under its opaque name: all that a diagnosis gets; recorded again if missing
``manifest.json``   the commitment, made before anything is diagnosed: SHA-256 of salt and truth, and of every campaign
``answers/``        the diagnosis of each campaign
``answers.json``    the commitment to the answers, made before the truth is opened
``judged/``         each answer judged against the truth
"""

from __future__ import annotations

import functools
import json
import secrets
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from inkjet_env.experiments.concealed_plant import RIG
from inkjet_env.experiments.execution.provenance import code_digest, first_difference, versions
from inkjet_env.experiments.proof.campaign_files import ProofError, check_campaign_only, digest
from inkjet_env.experiments.proof.chosen_cases import check_only
from inkjet_env.experiments.proof.corpus import PUBLISHED_SEED, RIGS, STAGES, VERSION
from inkjet_env.storage import UNFINISHED, json_text, remove_unfinished, stored_object, write_atomically

SETTINGS, MANIFEST, ANSWERS = "proof.json", "manifest.json", "answers.json"
PARTS = ("sealed/cases", "campaigns", "answers", "judged")
SOURCES = {
    "rig": ("experiments/concealed_rig/**/*.py", "experiments/proof/corpus.py"),
    "finder": ("inkjet_env/**/*.py",),
}
"""Files that determine the campaigns ("rig") and the answers ("finder")."""
NOTHING, NONE_OF_THESE = "nothing", "none of these"
"""Labels of a verdict's probabilities besides the ids: nothing is concealed, or something that no id stands for."""
JUDGE_SOURCES = (
    *(*SOURCES["rig"], *SOURCES["finder"], "optimizers/**/*.py", "experiments/proof/*.py"),
    *(f"experiments/{room}/**/*.py" for room in ("execution", "benchmark", "validation", "tuning")),
)


@dataclass(frozen=True)
class Settings:
    """Everything that determines a proof's numbers.

    Attributes
    ----------
    seed : int
        Seed of the corpus.
    profile : {"full", "quick"}
        Size of the corpus.
    rig : str
        Module of the concealed plant.
    only : tuple of str
        Names of the cases that it holds, see `chosen_cases`; empty: all.
    first : int
        Number of cases of each family, effects, strength and size, the first of the corpus; 0: all.
    """

    seed: int
    profile: str
    rig: str = RIG
    only: tuple[str, ...] = ()
    first: int = 0

    def __post_init__(self) -> None:
        check_only(self.only)

    @property
    def published(self) -> bool:
        """Whether the corpus is the published one."""
        return self.seed == PUBLISHED_SEED

    def to_json(self) -> dict[str, Any]:
        """The settings as plain JSON values, with digests of the code and the versions of packages."""
        return {
            "format": "proof-settings/1",
            "version": VERSION,
            "seed": self.seed,
            "profile": self.profile,
            "published": self.published,
            "rig": self.rig,
            "code": {part: code_digest(patterns) for part, patterns in SOURCES.items()},
            "versions": versions(),
            **({"only": sorted(self.only)} if self.only else {}),
            **({"first": self.first} if self.first else {}),
        }


def check_folder(folder: Path, settings: Settings) -> None:
    """Check that a folder, if it holds anything, belongs to this proof.

    Once all answers are committed to, code and packages other than those that gave them may judge them, on the same
    rig.

    Raises
    ------
    ProofError
        The folder holds a proof of another version, seed, profile or code, or something else.
    """
    file, asked = folder / SETTINGS, settings.to_json()
    if file.exists():
        stored = read_json(file)
        if (folder / ANSWERS).exists() and isinstance(code := stored.get("code"), dict):
            asked["versions"], asked["code"]["finder"] = stored.get("versions"), code.get("finder")
        if (version := stored.get("version")) in RIGS and version != VERSION:
            raise ProofError(
                f"{folder} holds a proof of corpus version {version}, and this code has version {VERSION}: the rig of "
                f"version {version} is at commit {RIGS[version]}. Check that out to judge its campaigns again; "
                "python -m inkjet_env.experiments.publish.proof_tables counts its stored judgements with this code too."
            )
        if difference := first_difference(stored, asked):
            raise ProofError(
                f"{folder} holds a proof with other settings: {difference}. "
                "Results are never mixed: give another folder with --out, or delete that one."
            )
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ProofError(f"{folder} is neither empty nor a proof's results folder. Give another one with --out.")


def open_folder(folder: Path, settings: Settings) -> None:
    """Create this proof's ``folder``, or resume the proof in it, without what a killed process left unfinished.

    Raises
    ------
    ProofError
        As `check_folder`; nothing in the folder is changed.
    """
    check_folder(folder, settings)
    for part in PARTS:
        (folder / part).mkdir(parents=True, exist_ok=True)
        for leftover in (folder / part).glob(f"*{UNFINISHED}"):
            if leftover.is_dir():
                shutil.rmtree(leftover)
        remove_unfinished(folder / part)
    remove_unfinished(folder)
    if not (folder / SETTINGS).exists():
        write_atomically(folder / SETTINGS, json_text(settings.to_json()))


def salt_of(folder: Path) -> str:
    """The proof's salt, drawn at the first call: 256 bits in hexadecimal, from the system rather than from the seed."""
    file = folder / "sealed" / "salt.txt"
    if not file.exists():
        write_atomically(file, secrets.token_hex(32) + "\n")
    salt = file.read_text(encoding="utf-8").strip()
    if len(salt) != 64:
        raise ProofError(f"{file} is damaged: it must hold 64 hexadecimal digits. Start again in another folder.")
    return salt


def canonical(value: Any) -> str:
    """The canonical JSON text of a value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=True)


def commitment(salt: str, truth: Any) -> str:
    """SHA-256 of salt and truth: it commits to the truth without revealing it."""
    return sha256(f"{salt}{canonical(truth)}".encode()).hexdigest()


def seal(folder: Path, cases: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Write the truth, then the manifest that commits to it and to every campaign; read the manifest if it exists.

    Parameters
    ----------
    folder : Path
        Folder of the proof.
    cases : mapping of str to dict
        Draw, attempt, digest of the campaign and truth by opaque name.

    Raises
    ------
    ProofError
        A campaign is not the one recorded, or its folder holds other files too.
    """
    if (folder / MANIFEST).exists():
        return verified_manifest(folder)
    for name, case in cases.items():
        check_campaign_only(folder / "campaigns" / name)
        _check_digest(folder, name, case["campaign"])
    truth = {name: dict(cases[name]) for name in sorted(cases)}
    write_atomically(folder / "sealed" / "truth.json", json_text({"format": "proof-truth/1", "cases": truth}))
    settings = read_json(folder / SETTINGS)
    manifest = settings | {
        "format": "proof/1",
        "truth_sha256": commitment(salt_of(folder), truth),
        "campaigns": {name: case["campaign"] for name, case in truth.items()},
    }
    write_atomically(folder / MANIFEST, json_text(manifest))
    return manifest


def verified_manifest(folder: Path) -> dict[str, Any]:
    """The manifest, after every campaign has been checked against it.

    Raises
    ------
    ProofError
        A campaign was changed, added or removed after sealing, or the manifest belongs to other settings.
    """
    manifest: dict[str, Any] = read_json(folder / MANIFEST)
    settings = read_json(folder / SETTINGS)
    if {name: manifest.get(name) for name in settings} != settings | {"format": "proof/1"}:
        raise ProofError(f"{folder / MANIFEST} does not match the settings in {SETTINGS}. Start again elsewhere.")
    sealed = manifest["campaigns"]
    for path in sorted((folder / "campaigns").iterdir()):
        if path.name not in sealed:
            raise ProofError(f"{path} was not sealed. Remove it: no campaign may be added after the truth was sealed.")
    for name, expected in sealed.items():
        check_campaign_only(folder / "campaigns" / name)
        _check_digest(folder, name, expected)
    return manifest


def _check_digest(folder: Path, name: str, expected: str) -> None:
    campaign = folder / "campaigns" / name
    if digest(campaign) != expected:
        raise ProofError(
            f"{campaign} was changed after it was sealed: its SHA-256 is no longer {expected[:16]}…. "
            "Restore the original, or start again in another folder."
        )


@functools.lru_cache(maxsize=100_000)
def _lies_in(path: str, folder: str) -> bool:
    """Whether a path begins with a folder's; kept, because every diagnosis opens the same thousand files."""
    return Path(path).is_relative_to(folder)


def check_answer(folder: Path, entry: Mapping[str, Any], manifest: Mapping[str, Any]) -> None:
    """Raise ``ProofError`` if an answer cannot be scored.

    It does not belong to a sealed campaign or its bytes differ, it names an unknown id, or the process that gave it
    looked into the proof's folder.
    """
    name = entry["name"]
    if manifest["campaigns"].get(name) != entry["campaign"]:
        raise ProofError(
            f"the answer to {name} does not belong to the campaign that was sealed. Delete {name}.json in {folder}."
        )
    verdict = entry["answer"]["verdict"] or {"effects": [], "candidates": []}
    reported = [effect["id"] for effect in verdict["effects"]]
    reported += [one for group in verdict["candidates"] for one in group]
    for one in reported:
        if one not in STAGES:
            raise ProofError(
                f"the verdict on {name} names {one!r}, which is not an id of the catalogue. Nothing is scored."
            )
    probabilities = verdict.get("probabilities") or {}
    for label in probabilities:
        if label not in STAGES and label not in (NOTHING, NONE_OF_THESE):
            raise ProofError(
                f"the verdict on {name} gives a probability of {label!r}, which is neither an id of the catalogue nor "
                f"{NOTHING!r} or {NONE_OF_THESE!r}. Nothing is scored."
            )
    total = sum(probabilities.values())
    if not total < 1 + 1e-3:  # less may be given: what no label gets is right for none
        raise ProofError(
            f"the probabilities in the verdict on {name} exceed 1 together: {total:.6g}. Nothing is scored."
        )
    own = str(folder.resolve())
    for path in entry["run"]["seen"]:
        if _lies_in(path, own):
            raise ProofError(
                f"the process that diagnosed {name} opened {path}, which only the judge may see. Nothing is scored."
            )


def commit_answers(folder: Path, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Write the digests of all answers and a digest over them, or check the answers against those already written.

    Raises
    ------
    ProofError
        An answer is missing, was changed after it was committed to, or cannot be scored.
    """
    found = {}
    for name in sorted(manifest["campaigns"]):
        entry = read_answer(folder, name)
        check_answer(folder, entry, manifest)
        found[name] = sha256(canonical(entry["answer"]).encode()).hexdigest()
    content = {
        "format": "proof-answers/1",
        "answers_sha256": sha256(canonical(found).encode()).hexdigest(),
        "each": found,
    }
    file = folder / ANSWERS
    if not file.exists():
        write_atomically(file, json_text(content))
    committed: dict[str, Any] = read_json(file)
    for name, expected in committed["each"].items():
        if found.get(name) != expected:
            raise ProofError(
                f"{answer_file(folder, name)} was changed after all answers were committed to. "
                "Restore the original, or start again in another folder."
            )
    return committed


def unseal(folder: Path, manifest: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The truth by opaque name, after it has been checked against the commitment.

    Raises
    ------
    ProofError
        The truth is not the one that was sealed.
    """
    file = folder / "sealed" / "truth.json"
    truth: dict[str, dict[str, Any]] = read_json(file)["cases"]
    if commitment(salt_of(folder), truth) != manifest["truth_sha256"]:
        raise ProofError(
            f"{file} is not the truth that was sealed: its SHA-256 with the salt differs from the manifest's. "
            "Nothing is scored."
        )
    return truth


def answer_file(folder: Path, name: str) -> Path:
    """Path of the answer to a campaign."""
    return folder / "answers" / f"{name}.json"


def read_answer(folder: Path, name: str) -> dict[str, Any]:
    """The answer to a campaign; ``ProofError`` if it is missing or damaged."""
    file = answer_file(folder, name)
    entry = read_json(file)
    if entry.get("name") != name or not {"answer", "run", "campaign"} <= entry.keys():
        raise ProofError(f"{file} is not the answer to {name}. Delete that file to repeat the diagnosis.")
    return entry


def read_json(file: Path) -> dict[str, Any]:
    """The JSON object in a file of the proof; ``ProofError`` if it is missing or damaged."""
    try:
        return stored_object(file)
    except (OSError, ValueError) as error:
        reason = error if isinstance(error, ValueError) else error.strerror
        raise ProofError(f"{file} cannot be read: {reason}. Restore it, or start again in another folder.") from None

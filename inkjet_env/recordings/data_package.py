"""A campaign as a Data Package: a folder with `datapackage.json` and one CSV file per recording."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from inkjet_env.printhead import nearest_name
from inkjet_env.recordings.campaign import Campaign, Source
from inkjet_env.recordings.instrument_file import open_table
from inkjet_env.recordings.oscilloscope import read_scope_samples
from inkjet_env.recordings.recording import SENSOR_COLUMNS, CampaignError, Recording, brief
from inkjet_env.recordings.samples import Samples, read_standard_samples
from inkjet_env.recordings.wiring import Wiring

DESCRIPTOR = "datapackage.json"
FORMAT = "campaign/1"
LARGEST_DESCRIPTOR = 1 << 26
"""Bytes of a descriptor beyond which it is not read."""


def read_data_package(
    folder: Path,
    wiring: Wiring,
    initial_state: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Campaign:
    """Read the campaign described by the folder's `datapackage.json`; see `read_campaign`."""
    path = folder / DESCRIPTOR
    package = _read_descriptor(path)
    resources = _field(path, "", package, "resources", list)
    if not resources:
        raise CampaignError(f"{path}: resources must list at least one recording; the list is empty.")
    notes: list[str] = []
    stated = _field(path, "", package, "inkjet", dict, {}).get("format")
    if stated is None:
        notes.append(f"{path}: does not state its format; read as {FORMAT}.")
    elif stated != FORMAT:
        raise CampaignError(f"{path}: inkjet.format must be {FORMAT!r}; got {brief(stated)}. Is it a newer one?")
    recordings: list[Recording] = []
    sources: dict[str, Source] = {}
    _check_different(path, resources)
    wiring.check_names(folder, [str(resource.get("name")) for resource in resources if isinstance(resource, dict)])
    for number, resource in enumerate(resources, start=1):
        if progress is not None:
            progress(f"reading ({number} of {len(resources)})")
        recording, source = _read_resource(folder, number, resource, wiring, initial_state, notes)
        recordings.append(recording)
        sources[recording.name] = source
    try:
        return Campaign(
            name=_field(path, "", package, "name", str, folder.resolve().name),
            recordings=tuple(recordings),
            title=_field(path, "", package, "title", str, ""),
            description=_field(path, "", package, "description", str, ""),
            notes=tuple(notes),
            sources=sources,
        )
    except CampaignError:
        raise
    except ValueError as error:
        raise CampaignError(f"{path}: {error}") from None


def _check_different(path: Path, resources: list[Any]) -> None:
    """Raise an error if two resources have one name or one file, before any is read."""
    for key in ("name", "path"):
        counts = Counter(str(resource.get(key)) for resource in resources if isinstance(resource, dict))
        value, count = next(iter(counts.most_common(1)), ("", 0))
        if count > 1 and value != "None":
            raise CampaignError(
                f"{path}: {count} resources have the {key} {brief(value)}. Give each recording its own, or remove all "
                "but one."
            )


def _read_descriptor(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise CampaignError(f"{path}: must be a file; it is a pipe, a device or a folder. Put the descriptor there.")
    try:
        if (size := path.stat().st_size) > LARGEST_DESCRIPTOR:
            raise CampaignError(f"{path}: holds {size:,} bytes, more than any descriptor. Is it the right file?")
        package = json.loads(path.read_text(encoding="utf-8-sig"))
        json.dumps(package, ensure_ascii=False).encode()  # JSON allows lone surrogates, which text cannot encode
    except OSError as error:
        raise CampaignError(f"{path}: cannot be read: {error.strerror or error}. Check the folder.") from None
    except json.JSONDecodeError as error:
        raise CampaignError(
            f"{path}, row {error.lineno}: is not JSON: {error.msg} at column {error.colno}. Correct that place."
        ) from None
    except UnicodeDecodeError as error:
        raise CampaignError(f"{path}: is not text in UTF-8 at byte {error.start + 1}. Save it in UTF-8.") from None
    except UnicodeEncodeError:
        raise CampaignError(f"{path}: holds half of a character, an escape of \\ud800 to \\udfff.") from None
    except RecursionError:
        raise CampaignError(f"{path}: is nested too deeply to be a descriptor. Is it the right file?") from None
    except ValueError as error:
        raise CampaignError(f"{path}: is not JSON: {str(error)[:120]}. Is it the right file?") from None
    if not isinstance(package, dict):
        raise CampaignError(f"{path}: must hold a JSON object {{…}}; got {brief(package)}.")
    return package


def _field(path: Path, place: str, holder: dict[str, Any], key: str, kind: type, default: Any = None) -> Any:
    """``holder[key]``, of type ``kind``; if it is missing, ``default``, or an error if that is None."""
    words: dict[type, str] = {str: "a string", list: "a list", dict: "an object {…}"}
    if key not in holder:
        if default is not None:
            return default
        raise CampaignError(f"{path}: {place}{key} is missing; it must be {words[kind]}.{nearest_name(key, holder)}")
    if not isinstance(holder[key], kind):
        raise CampaignError(f"{path}: {place}{key} must be {words[kind]}; got {brief(holder[key])}.")
    return holder[key]


def _read_resource(
    folder: Path,
    number: int,
    resource: Any,
    wiring: Wiring,
    initial_state: str | None,
    notes: list[str],
) -> tuple[Recording, Source]:
    path = folder / DESCRIPTOR
    place = f"resource {number}: "
    if not isinstance(resource, dict):
        raise CampaignError(f"{path}: {place}must be an object {{…}}; got {brief(resource)}.")
    name = _field(path, place, resource, "name", str)
    place = f"resource {brief(name)}: "
    if resource.get("format", "csv") != "csv":
        raise CampaignError(f"{path}: {place}format must be 'csv'; got {brief(resource['format'])}. Export it as CSV.")
    labels = _field(path, place, resource, "inkjet", dict, {})
    channel = wiring.channel_of.get(name, labels.get("channel", wiring.channel))
    state = labels.get("initial_state", initial_state or "free")
    if channel is None:
        raise CampaignError(
            f"{path}: {place}inkjet.channel is missing, so the sensor is unknown. "
            "Add it, self_sensing, strain_gauge or displacement, or give channel=."
        )
    for label, stated, wanted in (
        ("channel", channel, wiring.channel_for(name)),
        ("initial_state", state, initial_state),
    ):
        if wanted is not None and stated != wanted:
            notes.append(f"{path}: {place}{label} is {brief(stated)} in the descriptor; {wanted} was not applied.")
    file = _file_inside(folder, path, place, _field(path, place, resource, "path", str))
    if wiring.columns or name in wiring.columns_of:
        samples = read_scope_samples(file, wiring.columns_for(name, open_table(file)))
    else:
        samples = _standard_samples(file, path, place, resource)
    notes.extend(samples.notes)
    try:
        recording = Recording(
            name=name,
            channel=channel,
            excitation=labels.get("excitation", "arbitrary"),
            initial_state=state,
            order=labels.get("order", number),
            repeat_of=labels.get("repeat_of"),
            condition=labels.get("condition", {}),
            **samples.arrays,
        )
    except ValueError as error:
        raise CampaignError(f"{path}: {place}{error}") from None
    return recording, samples.source


def _file_inside(folder: Path, path: Path, place: str, given: str) -> Path:
    """File named by a descriptor, which must lie in the campaign's folder after links are followed."""
    rule = f"{path}: {place}path must name a file inside the folder; got {brief(given)}"
    try:
        file = folder / given
        inside = file.resolve().is_relative_to(folder.resolve())
        there = file.is_file()
    except (OSError, ValueError, RuntimeError):
        raise CampaignError(f"{rule}, which is not a file name. Correct it.") from None
    if not inside or Path(given).is_absolute() or ".." in Path(given).parts:
        raise CampaignError(f"{rule}, which is outside it. Copy the file into the folder.")
    if not there:
        raise CampaignError(f"{rule}; there is no such file. Correct the path, or put the file there.")
    return file


def _standard_samples(file: Path, path: Path, place: str, resource: dict[str, Any]) -> Samples:
    """Read a CSV file by the column names of the format, and check the descriptor's schema against its header."""
    samples = read_standard_samples(file)
    schema = _field(path, place, resource, "schema", dict, {})
    for entry in _field(path, place, schema, "fields", list, []):
        name = entry.get("name") if isinstance(entry, dict) else None
        if not isinstance(name, str):
            raise CampaignError(f"{path}: {place}schema.fields must be objects with a name; got {brief(entry)}.")
        if name not in samples.names:
            raise CampaignError(
                f"{path}: {place}schema.fields names {brief(name)}, which {file.name} has not; its columns are "
                f"{', '.join(samples.names)[:120]}. Correct either.{nearest_name(name[:60], samples.names)}"
            )
    return samples


def descriptor(campaign: Campaign) -> dict[str, Any]:
    """Data Package descriptor of a campaign whose recordings are in files named after them."""
    package: dict[str, Any] = {"name": campaign.name, "inkjet": {"format": FORMAT}}
    package |= {key: text for key in ("title", "description") if (text := getattr(campaign, key))}
    package["resources"] = [
        {
            "name": recording.name,
            "path": f"{recording.name}.csv",
            "format": "csv",
            "schema": {"fields": [{"name": name, "type": "number"} for name in recording_columns(recording)]},
            "inkjet": {
                "channel": recording.channel,
                "excitation": recording.excitation,
                "initial_state": recording.initial_state,
                "order": recording.order,
                "repeat_of": recording.repeat_of,
                "condition": dict(recording.condition),
            },
        }
        for recording in campaign.recordings
    ]
    return package


def recording_columns(recording: Recording) -> dict[str, Any]:
    """Columns of a recording's file, by their names in the file."""
    columns = {
        "time_s": recording.time_s,
        "drive_V": recording.drive_V,
        SENSOR_COLUMNS[recording.unit]: recording.sensor,
        "drive_monitor_V": recording.drive_monitor_V,
        "neighbour_V": recording.neighbour_V,
    }
    return {name: values for name, values in columns.items() if values is not None}


def listed_files(folder: Path) -> set[str]:
    """Names of the files directly in the folder that the descriptor lists."""
    path = folder / DESCRIPTOR
    resources = _field(path, "", _read_descriptor(path), "resources", list, [])
    return {str(resource.get("path")) for resource in resources if isinstance(resource, dict)}

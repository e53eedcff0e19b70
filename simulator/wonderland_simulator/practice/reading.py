"""A scenario file read: everything that is wrong with it, with line, field and what is allowed."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from wonderland.toml_settings import Address
from wonderland_edge_agent.commissioning.errors import SurveyError
from wonderland_edge_agent.commissioning.survey_files import load_survey
from wonderland_fabric_network.strict_yaml import StrictYaml, YamlError, read_yaml
from wonderland_simulator.configs import written
from wonderland_simulator.pads_air import node_name
from wonderland_simulator.practice.boards import DRONE_ADDRESS
from wonderland_simulator.practice.description import Fault, Pad, ScenarioFile, Vehicle, place_of
from wonderland_simulator.scenario import DWM1001, AnchorSite, Behaviour, DroneSpec, PadSite

MAX_FILE_BYTES: Final = 256 * 1024
FIRST_PORT: Final = 5_480
SHOWN: Final = 20
Step = str | int


class ScenarioError(Exception):
    """A scenario file that cannot be used. One line for each thing that is wrong."""


@dataclass(frozen=True)
class Problem:
    """What is wrong, and where: the way to the field from the file's root."""

    place: tuple[Step, ...]
    text: str


@dataclass(frozen=True)
class PadPlan:
    """A pad with everything that the file left open."""

    told: Pad
    site: PadSite
    ports: dict[str, Path]
    """By anchor."""
    remote_id: Address
    reports: Address | None
    """Where drones report, of a pad with DWM1001."""


@dataclass(frozen=True)
class VehiclePlan:
    """A vehicle with everything that the file left open."""

    told: Vehicle
    node: str
    port: Path
    board: int | None
    """Short address of its DWM1001."""
    position: Address | None
    """None: its autopilot is silent."""
    track: Path | None
    program: Path | None
    """Its autopilot's, where it has a real one."""
    files: Path
    """Directory for what that keeps."""

    @property
    def position_option(self) -> str:
        """``--position`` of its agent; empty where its autopilot is silent."""
        if self.position is None:
            return ""
        return f"{'udp' if self.told.autopilot is None else 'mavlink:udp'}:{written(self.position)}"

    @property
    def spec(self) -> DroneSpec:
        """As the ledger's registry wants to know it."""
        last, first = (place_of(self.told.path[index]) for index in (-1, 0))
        return DroneSpec(
            self.told.uav_id, self.told.model, self.told.pad, "land", Behaviour.HONEST, last, first, self.told.start_s
        )


@dataclass(frozen=True)
class Scenario:
    """A file that was found good; paths are absolute."""

    pads: tuple[PadPlan, ...]
    vehicles: tuple[VehiclePlan, ...]
    faults: tuple[Fault, ...]
    """In the order of their times."""
    seed: int


def read_scenario(path: Path) -> Scenario:
    """Read and check a file. Raises ScenarioError."""
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read ({error.strerror or error})") from error
    if len(data) > MAX_FILE_BYTES:
        raise ScenarioError(f"{path}: larger than {MAX_FILE_BYTES} bytes; is it the right file?")
    try:
        yaml = read_yaml(data)
    except YamlError as error:
        raise ScenarioError(f"{path}: {error}") from error
    try:
        file_says = ScenarioFile.model_validate(yaml.document)
    except ValidationError as error:
        raise _error(path, yaml, _problems(error.errors(include_url=False))) from error
    scenario, problems = complete(file_says, path.resolve().parent)
    if problems:
        raise _error(path, yaml, problems)
    return scenario


def _error(path: Path, yaml: StrictYaml, problems: Sequence[Problem]) -> ScenarioError:
    lines = [f"{path}, line {yaml.line(each.place)}: {_written(each.place)} {each.text}" for each in problems[:SHOWN]]
    if len(problems) > SHOWN:
        lines.append(f"{path}: and {len(problems) - SHOWN} more")
    return ScenarioError("\n".join(lines))


def _written(place: Sequence[Step]) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
    return text.removeprefix(".") or "the file"


def _problems(errors: Sequence[ErrorDetails]) -> list[Problem]:
    """Without what pydantic makes of lists of which an entry is wrong: it calls them too short."""
    inside = {error["loc"][:depth] for error in errors for depth in range(len(error["loc"]))}
    return [_problem(each) for each in errors if each["type"] != "too_short" or each["loc"] not in inside]


def _problem(error: ErrorDetails) -> Problem:
    """Pydantic's complaint in our words."""
    place = tuple(error["loc"])
    match error["type"]:
        case "extra_forbidden":
            known = _fields(place[:-1])
            return Problem(place, f"is unknown; known here: {', '.join(known)}")
        case "missing":
            return Problem(place, "is missing")
        case "model_type":
            return Problem(place, f"is {_short(error['input'])}, and should be a table of {', '.join(_fields(place))}")
        case "string_type" | "string_sub_type":
            return Problem(place, f"is {_short(error['input'])}, and should be a text (put it in quotes)")
    text = error["msg"].removeprefix("Value error, ").removeprefix("Input ")
    return Problem(place, f"is {_short(error['input'])}: {text[:1].lower()}{text[1:]}")


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}…"


def _fields(place: Sequence[Step]) -> list[str]:
    """What the table at a place may hold."""
    model: type[BaseModel] = ScenarioFile
    for step in place:
        field = model.model_fields.get(str(step))
        if field is not None:
            model = next(_models(field.annotation), model)
    return list(model.model_fields)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for each in get_args(annotation):
        yield from _models(each)


def complete(file: ScenarioFile, directory: Path) -> tuple[Scenario, list[Problem]]:
    """The file with ports and addresses for everything; and what no single field shows to be wrong."""
    problems: list[Problem] = []
    numbers = iter(range(FIRST_PORT, FIRST_PORT + 1_000))
    taken = {address for pad in file.pads for address in (pad.remote_id, pad.reports)} | {
        vehicle.position for vehicle in file.vehicles
    }
    free = (each for number in numbers if (each := Address(("127.0.0.1", number))) not in taken)
    pads = []
    for index, pad in enumerate(file.pads):
        sites, problem = _sites(pad, directory)
        if problem:
            problems.append(Problem(("pads", index, "survey"), problem))
        ports = (directory / (pad.ports or Path("ports", pad.pad_id))).resolve()
        lat_e7, lon_e7 = round(pad.origin.lat * 1e7), round(pad.origin.lon * 1e7)
        site = PadSite(
            pad.pad_id,
            pad.name or pad.pad_id,
            lat_e7,
            lon_e7,
            round(pad.origin.height_m * 1e3),
            sites,
            pad.buffer_mm,
            pad.clock_sigma_mm,
            profile=pad.node,
        )
        named = {each.anchor_id: ports / f"tty-{each.anchor_id}" for each in sites}
        reports = (pad.reports or next(free)) if pad.node == DWM1001 else None
        pads.append(PadPlan(pad, site, named, pad.remote_id or next(free), reports))
        unknown = sorted(set(pad.range_bias_m) - set(named))
        if unknown and sites:
            problems += [
                Problem(("pads", index, "range_bias_m", name), f"is no anchor of the survey; {', '.join(named)} are")
                for name in unknown
            ]
    kinds = {pad.pad_id: pad.node for pad in file.pads}
    nodes = [each.node or kinds.get(each.pad, "DWM3001CDK") for each in file.vehicles]
    vehicles = tuple(
        VehiclePlan(
            each,
            node,
            _plain(directory / (each.port or Path("ports", f"tty-{each.uav_id}"))),
            DRONE_ADDRESS + index if node == DWM1001 else None,
            each.position or next(free),
            None if each.track is None else _plain(directory / each.track),
            None if each.autopilot is None else (directory / each.autopilot.program).resolve(),
            directory / "autopilots" / each.uav_id,
        )
        for index, (each, node) in enumerate(zip(file.vehicles, nodes, strict=True))
    )
    faults = tuple(sorted(file.faults, key=lambda each: each.at_s))
    scenario = Scenario(tuple(pads), vehicles, faults, file.seed)
    return scenario, problems or list(_contradictions(scenario, file.faults))


def _plain(path: Path) -> Path:
    """The same place, always written the same way; a link at its end is not followed."""
    return path.parent.resolve() / path.name


def _sites(pad: Pad, directory: Path) -> tuple[tuple[AnchorSite, ...], str]:
    """The pad's anchors; or none, and what is wrong with its survey."""
    try:
        anchors = load_survey(directory / pad.survey).anchors
    except SurveyError as error:
        return (), str(error).replace("\n", " ")
    return tuple(
        AnchorSite(each.anchor_id, each.mac, *each.place_m, pad.range_bias_m.get(each.anchor_id, 0.0))
        for each in anchors
    ), ""


def _contradictions(scenario: Scenario, faults: Sequence[Fault]) -> Iterator[Problem]:
    """What no single field shows."""
    names: dict[str, str] = {}
    paths: dict[Path, str] = {}
    addresses: dict[Address, str] = {}
    nodes: set[str] = set()
    kinds = {pad.told.pad_id: pad.told.node for pad in scenario.pads}
    for index, pad in enumerate(scenario.pads):
        here = ("pads", index)
        yield from _only_once(names, pad.told.pad_id, (*here, "pad_id"))
        yield from _only_once(addresses, pad.remote_id, (*here, "remote_id"))
        if pad.reports is not None:
            yield from _only_once(addresses, pad.reports, (*here, "reports"))
        elif pad.told.reports is not None:
            yield Problem((*here, "reports"), f"is for node: {DWM1001}")
        for anchor_id, port in pad.ports.items():
            nodes.add(node_name(pad.told.pad_id, anchor_id))
            yield from _only_once(paths, port, (*here, "ports"))
    for index, vehicle in enumerate(scenario.vehicles):
        place = ("vehicles", index)
        yield from (twice := list(_only_once(names, vehicle.told.uav_id, (*place, "uav_id"))))
        if vehicle.position is not None:
            yield from _only_once(addresses, vehicle.position, (*place, "position"))
        if vehicle.told.pad in kinds and (kinds[vehicle.told.pad] == DWM1001) != (vehicle.node == DWM1001):
            yield Problem((*place, "node"), f"is {vehicle.node} at a pad of {kinds[vehicle.told.pad]}")
        if not twice:  # the port has its name
            yield from _only_once(paths, vehicle.port, (*place, "port"))
        if vehicle.track is not None:
            yield from _only_once(paths, vehicle.track, (*place, "track"))
        if vehicle.told.pad not in kinds:
            yield Problem((*place, "pad"), f"is {vehicle.told.pad!r}, and no pad of this file; {', '.join(kinds)} are")
        if vehicle.told.lies.gnss_drag is not None and vehicle.told.lies.gnss_jump is not None:
            yield Problem((*place, "lies"), "has gnss_drag and gnss_jump; a receiver is led away in one way")
        yield from _of_its_autopilot(vehicle, place)
    flying = {vehicle.told.uav_id for vehicle in scenario.vehicles}
    for index, fault in enumerate(faults):
        at = ("faults", index)
        if fault.node not in nodes | flying:
            known = ", ".join(sorted(nodes | flying))
            yield Problem((*at, "node"), f"is {fault.node!r}, and no node of this file; {known} are")
        if (fault.what == "move") != (fault.by_m is not None):
            yield Problem((*at, "by_m"), "and what: move go together")
        elif fault.what == "move" and fault.node in flying:
            yield Problem((*at, "what"), "is 'move', and that is for anchors; vehicles move by their path")


def _of_its_autopilot(vehicle: VehiclePlan, place: tuple[Step, ...]) -> Iterator[Problem]:
    """What a real one does not do because a file says so."""
    told = vehicle.told
    if told.autopilot is None or vehicle.program is None:
        return
    if not (vehicle.program.is_file() and os.access(vehicle.program, os.X_OK)):
        yield Problem(
            (*place, "autopilot", "program"),
            f"is {vehicle.program}, and no program; build ArduPilot's copter for the board sitl (docs/practise.md)",
        )
    if len(told.path) > 1:
        yield Problem((*place, "path"), "has more than the place where it stands: whoever flies its autopilot leads it")
    told_by_file = told.model_fields_set & {"repeat", "start_s", "gnss_sigma_m"}
    for name in sorted(told_by_file):
        yield Problem((*place, name), "is not for a vehicle with an autopilot")
    for name in sorted(told.lies.model_fields_set - {"gnss_drag", "gnss_jump", "ranges", "replay"}):
        yield Problem((*place, "lies", name), "is not for a vehicle with an autopilot: its agent claims what that says")


def _only_once(seen: dict[Any, str], value: object, place: tuple[Step, ...]) -> Iterator[Problem]:
    if value in seen:
        shown = f"{value[0]}:{value[1]}" if isinstance(value, Address) else str(value)
        yield Problem(place, f"is {shown}, which is {seen[value]} already")
    else:
        seen[value] = _written(place)

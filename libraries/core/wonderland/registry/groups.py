"""The commands of each kind of the registry."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

from wonderland.problems import SaidError
from wonderland.proof_contract import ProofContract
from wonderland.proofs.errors import ProofError
from wonderland.proofs.records import transactions as tx
from wonderland.proofs.records.changes import ProposedChange
from wonderland.proofs.records.closures import Closures
from wonderland.proofs.records.pads import Pad
from wonderland.proofs.records.policies import Policy
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.uavs import Uav
from wonderland.registry.book import Book
from wonderland.registry.changes import DIFFERS, NEW, REFUSED, Change, compared, recorded, submit_all
from wonderland.registry.lists import KINDS, MAX_BYTES, REGISTRATION, Kind, check, check_json, written
from wonderland.registry.session import Ledger, as_format, book_of, of_a_ledger, progress, show, show_record

_file = click.Path(exists=True, dir_okay=False, path_type=Path)
_dry_run = click.option("--dry-run", is_flag=True, help="Say what would be submitted, and submit nothing.")
_reason = click.option("--reason", required=True, help="Why; stays on the ledger for good.")
_openings = click.option(
    "--openings",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="DIR",
    help="Where the openings of registration numbers are kept: they never go to the ledger.",
)


def _submit(ledger: Ledger, argument: Record, *, dry_run: bool) -> None:
    """One transaction, and where it stands."""
    if dry_run:
        click.echo(f"would submit {type(argument).__name__} {json.dumps(argument.to_json(), ensure_ascii=False)}")
        return
    _, done = ledger.run(lambda contract: contract.change(argument))
    click.echo(f"{type(argument).__name__} is VALID: transaction {done.tx_id}, block {done.block_number}")


def _made(kind: type[Record], **values: Any) -> Record:
    """An argument. A value that is none ends the command."""
    try:
        return kind.parse({name: value for name, value in values.items() if value is not None})
    except ProofError as error:
        raise click.UsageError(str(error)) from error


def _read(contract_work: Callable[[Book], Any]) -> Callable[[ProofContract], Any]:
    async def work(contract: ProofContract) -> Any:
        return contract_work(await book_of(contract))

    return work


def _records(name: str, book: Book) -> list[tuple[Record, dict[str, str]]]:
    """Everything of a kind: what has its state, and its columns."""
    kind = KINDS[name]
    match name:
        case "pads":
            return [(each, written(kind, each)) for _, each in sorted(book.pads.items())]
        case "drones":
            return [(each, written(kind, each)) for _, each in sorted(book.drones.items())]
        case "authorisations":
            return [(each, written(kind, each)) for _, each in sorted(book.authorisations.items())]
        case _:
            return [(each, {**written(kind, each), "uav_id": uav_id}) for uav_id, each in book.maintenance()]


def _state(record: Record) -> str:
    document = record.to_json()
    if "revoked" in document:
        return "revoked" if document["revoked"] else "granted"
    return str(document.get("status", ""))


def _group(name: str, what: str) -> click.Group:
    """The commands that every kind of list has."""
    kind = KINDS[name]

    @click.group(name, help=what)
    def group() -> None:
        pass

    @group.command("list")
    @of_a_ledger
    @as_format
    def list_(*, ledger: Ledger, as_format: str) -> None:
        """Everything that the ledger has, with its state."""
        found = ledger.run(_read(lambda book: _records(name, book)))
        rows = [{**columns, "state": _state(record)} for record, columns in found]
        columns = [each for each in kind.columns if each != REGISTRATION]
        show([{each: row[each] for each in (*columns, "state")} for row in rows], (*columns, "state"), as_format)

    @group.command("show")
    @click.argument("parts", nargs=len(kind.key), metavar=" ".join(each.upper() for each in kind.key))
    @of_a_ledger
    def show_one(*, parts: str | tuple[str, ...], ledger: Ledger) -> None:
        """One record, whole, as the ledger has it."""
        wanted = parts if isinstance(parts, str) else "/".join(parts)
        found = ledger.run(_read(lambda book: recorded(kind, book, wanted)))
        if found is None:
            raise click.ClickException(f"{wanted}: the ledger has none of that id")
        show_record(found.to_json())

    @group.command()
    @of_a_ledger
    @click.option(
        "--format",
        "as_format",
        type=click.Choice(("csv", "json")),
        default="csv",
        show_default=True,
        help="As a list that `import` reads.",
    )
    def export(*, ledger: Ledger, as_format: str) -> None:
        """What holds now, as `import` reads it: without what is retired or revoked, and without numbers."""
        found = ledger.run(_read(lambda book: _records(name, book)))
        rows = [columns for record, columns in found if _state(record) not in {"retired", "revoked"}]
        show(rows, tuple(kind.columns), as_format)

    @group.command("import")
    @click.argument("file", type=_file)
    @of_a_ledger
    @_dry_run
    @click.option("--json", "as_json", is_flag=True, help="A line of JSON for each entry of the list.")
    def import_(*, file: Path, ledger: Ledger, dry_run: bool, as_json: bool, openings: Path | None = None) -> None:
        """Bring a list (CSV, or JSON by its suffix) to the ledger.

        What is there already is left out, so that an import that was interrupted is run again. What differs from the
        ledger is named and left alone. Exit code 1 where anything was refused, or differs.
        """
        _import(kind, file, ledger, openings, dry_run=dry_run, as_json=as_json)

    if REGISTRATION in kind.columns:
        _openings(import_)

    def add(*, ledger: Ledger, dry_run: bool, openings: Path | None = None, **cells: str | None) -> None:
        given = {each: value for each, value in cells.items() if value is not None}
        rows = _checked(kind, json.dumps([given]).encode(), check_json)
        (change,) = ledger.run(_read(lambda book: compared(kind, rows, book, openings)))
        if change.state != NEW:
            raise click.ClickException(f"{change.id}: {change.state}{': ' if change.why else ''}{change.why}")
        if dry_run:
            _submit(ledger, change.argument, dry_run=True)
            return
        (done,) = ledger.run(lambda contract: submit_all(contract, [change], openings, lambda _: None))
        if done.state == REFUSED:
            raise click.ClickException(done.why)
        click.echo(f"{done.id}: {done.why}")

    add.__doc__ = f"Submit one {kind.function}."
    properties = kind.argument.json_schema()["properties"]
    for column_name, column in reversed(list(kind.columns.items())):
        described = column.says or properties[column.field]["description"]
        option = f"--{column_name.replace('_', '-')}"
        add = click.option(option, column_name, required=not column.optional, help=f"{described}.")(add)
    if REGISTRATION in kind.columns:
        add = _openings(add)
    group.command("add")(of_a_ledger(_dry_run(add)))
    return group


def _checked(kind: Kind, data: bytes, reading: Callable[[Kind, bytes], Any]) -> list[dict[str, Any]]:
    """The rows of a list that is all right; else every error, and the end."""
    try:
        found = reading(kind, data)
    except SaidError as error:
        raise click.ClickException(str(error)) from error
    for each in found.errors:
        click.echo(f"line {each.line}{', ' if each.column else ''}{each.column}: {each.message}", err=True)
    if found.errors:
        raise click.ClickException(f"{len(found.errors)} of these; nothing was submitted")
    rows: list[dict[str, Any]] = found.rows
    return rows


def _import(kind: Kind, file: Path, ledger: Ledger, openings: Path | None, *, dry_run: bool, as_json: bool) -> None:
    with file.open("rb") as opened:
        data = opened.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise click.ClickException(f"{file}: more than {MAX_BYTES} bytes; bring it in parts")
    rows = _checked(kind, data, check_json if file.suffix.lower() == ".json" else check)

    def told(change: Change) -> None:
        if as_json:
            click.echo(json.dumps(change.to_json(), ensure_ascii=False))
        elif change.why or dry_run:
            click.echo(f"line {change.line}, {change.id}: {change.state}{': ' if change.why else ''}{change.why}")

    async def work(contract: ProofContract) -> list[Change]:
        changes = compared(kind, rows, await book_of(contract), openings)
        for each in changes:
            if each.state != NEW or dry_run:
                told(each)
        if dry_run:
            return changes
        with progress() as shown:
            task = shown.add_task("Submitting", total=sum(each.state == NEW for each in changes))

            def ended(change: Change) -> None:
                shown.advance(task)
                if as_json or change.state == REFUSED:
                    told(change)

            return await submit_all(contract, changes, openings, ended)

    done = ledger.run(work)
    counts: dict[str, int] = {}
    for each in done:
        counts[each.state] = counts.get(each.state, 0) + 1
    click.echo(f"{file}: {', '.join(f'{number} {state}' for state, number in counts.items())}", err=True)
    if counts.keys() & {REFUSED, DIFFERS}:
        raise click.exceptions.Exit(1)


pads: Final = _group("pads", "Landing pads.")
drones: Final = _group("drones", "Drones.")
maintenance: Final = _group("maintenance", "What was done to drones, and until when it is good.")
authorisations: Final = _group("authorisations", "Which drone may do what at which pad, and when.")


@pads.command("edit")
@click.argument("pad_id")
@of_a_ledger
@click.option("--name", help="Its name for people.")
@click.option("--operator-id", help="Who operates it.")
@click.option("--note", help="A note for people.")
@_dry_run
def edit_pad(*, pad_id: str, ledger: Ledger, dry_run: bool, **changed: str | None) -> None:
    """Change a pad's name, operator or note. Where it stands, no transaction changes: commission it anew."""
    if not any(changed.values()):
        raise click.UsageError("say what to change: --name, --operator-id or --note")
    _submit(ledger, _made(tx.UpdatePad, pad_id=pad_id, **changed), dry_run=dry_run)


@pads.command("retire")
@click.argument("pad_id")
@of_a_ledger
@_reason
@_dry_run
def retire_pad(*, pad_id: str, ledger: Ledger, reason: str, dry_run: bool) -> None:
    """No proof is asked for there any more; this cannot be taken back."""
    _submit(ledger, _made(tx.RetirePad, pad_id=pad_id, reason=reason), dry_run=dry_run)


def _set_status(command: str, status: str, text: str) -> None:
    @drones.command(command, help=text)
    @click.argument("uav_id")
    @of_a_ledger
    @_reason
    @_dry_run
    def setting(*, uav_id: str, ledger: Ledger, reason: str, dry_run: bool) -> None:
        _submit(ledger, _made(tx.SetUavStatus, uav_id=uav_id, status=status, reason=reason), dry_run=dry_run)


_set_status("suspend", "suspended", "It gets no permission until two people have reinstated it.")
_set_status("retire", "retired", "It is out of service; this cannot be taken back.")


@drones.command("reinstate")
@click.argument("uav_id")
@of_a_ledger
@_reason
@_dry_run
def reinstate(*, uav_id: str, ledger: Ledger, reason: str, dry_run: bool) -> None:
    """Propose that a suspended drone flies again; another person approves it (`registry policies approve`)."""
    _submit(ledger, _made(tx.ProposeReinstatement, uav_id=uav_id, reason=reason), dry_run=dry_run)


@authorisations.command("revoke")
@click.argument("uav_id")
@click.argument("authorisation_id")
@of_a_ledger
@_reason
@_dry_run
def revoke(*, uav_id: str, authorisation_id: str, ledger: Ledger, reason: str, dry_run: bool) -> None:
    """Take an authorisation back."""
    argument = _made(tx.RevokeAuthorisation, uav_id=uav_id, authorisation_id=authorisation_id, reason=reason)
    _submit(ledger, argument, dry_run=dry_run)


@click.group()
def operators() -> None:
    """Operators, as pads and drones name them. The ledger has no more of them than that."""


@operators.command("list")
@of_a_ledger
@as_format
def list_operators(*, ledger: Ledger, as_format: str) -> None:
    """Each operator with its organisation and how many pads and drones it has in service."""

    def counted(book: Book) -> list[dict[str, str]]:
        found: dict[tuple[str, str], list[int]] = {}
        both: list[Pad | Uav] = [*book.pads.values(), *book.drones.values()]
        for each in both:
            counts = found.setdefault((each.operator_id, each.msp_id), [0, 0])
            counts[isinstance(each, Uav)] += each.status != "retired"
        return [
            {"operator_id": name, "msp_id": msp_id, "pads": str(pads), "drones": str(drones)}
            for (name, msp_id), (pads, drones) in sorted(found.items())
        ]

    show(ledger.run(_read(counted)), ("operator_id", "msp_id", "pads", "drones"), as_format)


@click.group()
def policies() -> None:
    """What pads ask of a proof. A change is proposed by one person and approved by another."""


@policies.command("list")
@of_a_ledger
@as_format
def list_policies(*, ledger: Ledger, as_format: str) -> None:
    """The policies that were approved; for everything else the defaults hold."""

    def listed(book: Book) -> list[dict[str, str]]:
        rows = []
        for (pad_id, action), change in sorted(book.policies.items()):
            assert change.policy is not None
            policy = change.policy.policy
            row = {"pad_id": pad_id, "action": action, "buffer_mm": policy.buffer_mm, "assurance": policy.min_assurance}
            by = change.decided_by.name if change.decided_by is not None else ""
            rows.append({**{name: str(value) for name, value in row.items()}, "approved_by": by})
        return rows

    show(ledger.run(_read(listed)), ("pad_id", "action", "buffer_mm", "assurance", "approved_by"), as_format)


@policies.command("show")
@click.argument("pad_id")
@click.argument("action", type=click.Choice(("land", "takeoff", "dock")), default="land")
@of_a_ledger
def show_policy(*, pad_id: str, action: str, ledger: Ledger) -> None:
    """The policy in force at a pad for an action, as the contract answers."""
    show_record(ledger.run(lambda contract: contract.read_policy(pad_id, action)).to_json())


@policies.command("propose")
@click.argument("pad_id")
@click.argument("action", type=click.Choice(("*", "land", "takeoff", "dock")), default="*")
@of_a_ledger
@click.option("--file", "file", type=_file, help="The whole policy, in JSON, as `show` prints it.")
@click.option("--set", "changed", multiple=True, metavar="FIELD=VALUE", help="A field; the others stay as they are.")
@click.option("--note", help="Why, for whoever approves it.")
@_dry_run
def propose_policy(
    *,
    pad_id: str,
    action: str,
    ledger: Ledger,
    file: Path | None,
    changed: tuple[str, ...],
    note: str | None,
    dry_run: bool,
) -> None:
    """Propose a policy for a pad (or *) and an action (or *); another person approves it."""
    if (file is None) == (not changed):
        raise click.UsageError("say one of --file and --set")
    try:
        if file is not None:
            document = json.loads(file.read_text(encoding="utf-8"))
        else:
            asked = "land" if action == "*" else action
            document = Policy().to_json()
            if pad_id != "*":
                document = ledger.run(lambda contract: contract.read_policy(pad_id, asked)).to_json()
            document |= dict(map(_field, changed))
        policy = Policy.parse(document)
    except (ValueError, ProofError) as error:
        raise click.UsageError(str(error)) from error
    _submit(
        ledger,
        _made(tx.ProposePolicy, pad_id=pad_id, action=action, policy=policy.to_json(), note=note),
        dry_run=dry_run,
    )


def _field(text: str) -> tuple[str, Any]:
    name, separator, value = text.partition("=")
    if not separator:
        raise ValueError(f"--set {text}: is not FIELD=VALUE")
    try:
        return name, json.loads(value)
    except ValueError:
        return name, value


@policies.command("proposals")
@of_a_ledger
@as_format
def proposals(*, ledger: Ledger, as_format: str) -> None:
    """What waits for a second person, and what became of the rest."""

    def listed(book: Book) -> list[dict[str, str]]:
        return [
            {
                "change_id": each.change_id,
                "state": each.state,
                "of": _about(each),
                "proposed_by": each.proposed_by.name,
                "note": each.note or "",
            }
            for each in book.proposals.values()
        ]

    show(ledger.run(_read(listed)), ("change_id", "state", "of", "proposed_by", "note"), as_format)


def _about(change: ProposedChange) -> str:
    if change.policy is not None:
        return f"policy of {change.policy.pad_id} for {change.policy.action}"
    return f"reinstatement of {change.reinstatement.uav_id}" if change.reinstatement is not None else ""


@policies.command("approve")
@click.argument("change_id")
@of_a_ledger
@click.option("--yes", is_flag=True, help="Without asking.")
@_dry_run
def approve(*, change_id: str, ledger: Ledger, yes: bool, dry_run: bool) -> None:
    """Approve what somebody else proposed, policies and reinstatements alike, once you have seen what it changes."""

    async def read(contract: ProofContract) -> tuple[ProposedChange, Policy | None]:
        change = (await book_of(contract)).proposals.get(change_id)
        if change is None:
            raise click.ClickException(f"{change_id}: nobody has proposed that")
        now = None
        if change.policy is not None and change.policy.pad_id != "*":
            action = "land" if change.policy.action == "*" else change.policy.action
            now = await contract.read_policy(change.policy.pad_id, action)
        return change, now

    change, now = ledger.run(read)
    click.echo(f"{_about(change)}, proposed by {change.proposed_by.name} ({change.proposed_by.msp_id}):")
    if change.policy is not None:
        before = (now or Policy()).to_json()
        after = change.policy.policy.to_json()
        for name in sorted(before.keys() | after.keys()):
            if before.get(name) != after.get(name):
                click.echo(f"  {name}: {before.get(name)} → {after.get(name)}")
    if change.reinstatement is not None:
        click.echo(f"  {change.reinstatement.reason}")
    if not (yes or dry_run):
        click.confirm("Approve?", abort=True, err=True)
    argument = tx.ApproveChange(change_id=change_id, policy=change.policy, reinstatement=change.reinstatement)
    _submit(ledger, argument, dry_run=dry_run)


@policies.command("withdraw")
@click.argument("change_id")
@of_a_ledger
@_reason
@_dry_run
def withdraw(*, change_id: str, ledger: Ledger, reason: str, dry_run: bool) -> None:
    """Take a proposal back, or turn somebody's down."""
    _submit(ledger, _made(tx.WithdrawChange, change_id=change_id, reason=reason), dry_run=dry_run)


@click.group()
def closures() -> None:
    """When zones close a pad. A backend writes them from the zones that it has; here they are read, or set by hand."""


@closures.command("list")
@of_a_ledger
@as_format
def list_closures(*, ledger: Ledger, as_format: str) -> None:
    """Each pad's closures, one line for each span."""
    kind = KINDS["authorisations"].columns["valid_from"]

    def listed(book: Book) -> list[dict[str, str]]:
        return [
            {
                "pad_id": pad_id,
                "zone_id": each.zone_id,
                "actions": " ".join(each.actions),
                "from": kind.write(each.from_ms),
                "until": kind.write(each.until_ms),
            }
            for pad_id, closed in sorted(book.closures.items())
            for each in closed.closures
        ]

    show(ledger.run(_read(listed)), ("pad_id", "zone_id", "actions", "from", "until"), as_format)


@closures.command("show")
@click.argument("pad_id")
@of_a_ledger
def show_closures(*, pad_id: str, ledger: Ledger) -> None:
    """What was said last of a pad, and until when that holds."""
    found: Closures | None = ledger.run(_read(lambda book: book.closures.get(pad_id)))
    if found is None:
        raise click.ClickException(f"{pad_id}: nothing was ever said of its closures")
    show_record(found.to_json())


@closures.command("set")
@click.argument("pad_id")
@click.argument("file", type=_file)
@of_a_ledger
@_dry_run
def set_closures(*, pad_id: str, file: Path, ledger: Ledger, dry_run: bool) -> None:
    """Set a pad's closures from a file in JSON with `closures` and `valid_until_ms`, as `show` prints them.

    It replaces what was said before. A backend that keeps zones writes anew when these change.
    """
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
        said = {name: document[name] for name in ("closures", "valid_until_ms")}
    except (ValueError, KeyError, TypeError) as error:
        raise click.ClickException(f"{file}: needs closures and valid_until_ms, in JSON ({error})") from error
    _submit(ledger, _made(tx.SetClosures, pad_id=pad_id, **said), dry_run=dry_run)

"""One session as the host drives it: which command comes next, and what each answer means. Sans-I/O.

Goal-driven rather than scripted: it knows what the node last said about the session and what its owner wants, and
names the one command that brings the first nearer to the second. So a lost notification, a rebooted node and an
answer in an odd order all mend the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from wonderland_fira_uci.uci.config import SessionConfig, parameter_name
from wonderland_fira_uci.uci.errors import UciConfigRejectedError, UciError, UciStateError, UciStatusError
from wonderland_fira_uci.uci.packets import Group
from wonderland_fira_uci.uci.session import (
    Command,
    Response,
    SessionConfigOp,
    SessionControlOp,
    command_name,
    decode_config_refusal,
    decode_init_response,
    decode_state_response,
    deinit_command,
    get_state_command,
    init_command,
    set_app_config_command,
    start_command,
    stop_command,
)
from wonderland_fira_uci.uci.status import SessionState, Status

MAX_SETUPS: Final = 5
MAX_START_REFUSALS: Final = 3
STATE_TIMEOUT_MS: Final = 400
CREDIT_TIMEOUT_MS: Final = 1_000
_ABSENT: Final = (Status.SESSION_NOT_EXIST,)
# A node that does not know GET_STATE; REJECTED is what some answer to any opcode they lack.
_STATE_UNKNOWN: Final = (Status.UNKNOWN_OID, Status.UNKNOWN_GID, Status.REJECTED, Status.SYNTAX_ERROR)


@dataclass(frozen=True, slots=True)
class StateChanged:
    """The node's word about the session; ``state`` None: it does not know it (any more)."""

    state: SessionState | None
    reason: int


@dataclass(frozen=True, slots=True)
class Ended:
    """Closed as wanted (``error`` None), or given up."""

    error: UciError | None


class SessionMachine:
    """``wanted``: True while the session shall be ACTIVE, False once it shall be gone."""

    def __init__(self, config: SessionConfig, other: Callable[[int], SessionMachine | None] = lambda _id: None) -> None:
        """``other``: another session of the node by its id, for a common time base."""
        self.config = config
        self._other = other
        self.handle = config.session_id
        self.wanted = True
        self.state: SessionState | None = None
        self.ended = False
        self.error: UciError | None = None
        self.credit = True
        self.credit_timeouts = 0
        """Data packets running for which the node gave no credit back."""
        self.data_sequence = 0
        self.heard_ms = 0
        self._configured = False
        self._setups = 0
        self._start_refusals = 0
        self._duplicates = 0
        self._remove_first = False
        self._verify = False
        self._awaiting = False
        self._awaited: SessionState | None = None
        self._deadline_ms = 0
        self._credit_deadline_ms: int | None = None

    @property
    def session_id(self) -> int:
        """The id shared by all nodes."""
        return self.config.session_id

    @property
    def active(self) -> bool:
        """Whether the node ranges."""
        return self.state is SessionState.ACTIVE

    def verify(self) -> None:
        """Ask the node for the state before believing anything else."""
        if self.state is not None:
            self._verify = True

    def close(self) -> None:
        """The session shall be gone."""
        self.wanted = False

    def forget(self) -> bool:
        """The node has lost everything. Returns whether the session was there."""
        was = self.state is not None
        self.state, self._configured, self._verify, self._awaiting = None, False, False, False
        self._setups, self._duplicates, self._remove_first = 0, 0, False  # the node's fault, not the session's
        self.handle = self.config.session_id
        self.credit, self._credit_deadline_ms = True, None
        self.ended = self.ended or not self.wanted
        return was

    def next_command(self, now_ms: int) -> Command | None:
        """The next command, or None while there is nothing to do but wait."""
        if self.ended:
            return None
        if self._verify:
            self._verify = False
            return get_state_command(self.handle)
        if self._awaiting:
            if self.state is not self._awaited:
                if now_ms < self._deadline_ms:
                    return None
                self._awaiting = False
                return get_state_command(self.handle)
            self._awaiting = False
        if self._remove_first:
            self._remove_first = False
            return deinit_command(self.handle)
        if not self.wanted:
            if self.state is None:
                self.ended = True
                return None
            return stop_command(self.handle) if self.active else deinit_command(self.handle)
        if self.state is None:
            self._setups += 1
            if self._setups > MAX_SETUPS:
                self._give_up(UciStateError(f"the session was lost {MAX_SETUPS} times before it became active"))
                self.ended = True
                return None
            return init_command(self.session_id, self.config.session_type)
        if not self._configured:
            return self._set_app_config(now_ms)
        return None if self.active else start_command(self.handle)

    def _set_app_config(self, now_ms: int) -> Command | None:
        """The configuration; None while the session that gives the time has no handle yet."""
        parameters, base = self.config.app.parameters(), self.config.time_base
        if base is not None:
            other = self._other(base.session_id)
            if other is None or not other.wanted:
                text = f"session {base.session_id:#010x}, on whose time base this one shall run, is not open"
                self._give_up(UciStateError(text))
                return self.next_command(now_ms)
            if other.state is None:
                return None
            parameters.append(base.parameter(other.handle))
        return set_app_config_command(self.handle, parameters)

    def next_timeout_ms(self) -> int | None:
        """When something is due although nothing is heard."""
        times = [self._deadline_ms if self._awaiting else None, self._credit_deadline_ms]
        return min((t for t in times if t is not None), default=None)

    def advance(self, now_ms: int) -> bool:
        """Lets time pass; True when the credit came back by timeout (its notification was lost)."""
        if self._credit_deadline_ms is not None and now_ms >= self._credit_deadline_ms:
            self.credit, self._credit_deadline_ms = True, None
            self.credit_timeouts += 1
            return True
        return False

    def set_credit(self, *, granted: bool) -> None:
        """The node's word on credit."""
        self.credit = granted
        if granted:
            self._credit_deadline_ms, self.credit_timeouts = None, 0

    def spend_credit(self, now_ms: int) -> int:
        """Takes the credit for one data packet and returns its sequence number."""
        self.credit = False
        self._credit_deadline_ms = now_ms + CREDIT_TIMEOUT_MS
        self.data_sequence = (self.data_sequence + 1) & 0xFFFF
        return self.data_sequence

    def on_state(self, octet: int, reason: int) -> StateChanged | None:
        """A state notification; None when it says nothing new."""
        try:
            state: SessionState | None = SessionState(octet)
        except ValueError:
            return None
        if state is SessionState.DEINIT:
            state = None
        if state is self.state:
            return None
        if self.active and state is SessionState.IDLE and reason == 0 and self.wanted:
            # Nobody asked it to stop: perhaps the late echo of an earlier step. Ask before acting on it.
            self._verify = True
            return None
        return self._set_state(state, reason)

    def _set_state(self, state: SessionState | None, reason: int) -> StateChanged:
        self.state = state
        if state is None:
            self._configured = False
            self.handle = self.session_id
        elif state is SessionState.ACTIVE:
            self._setups = self._start_refusals = self._duplicates = 0
            self.credit, self._credit_deadline_ms = True, None
        return StateChanged(state, reason)

    def on_response(self, response: Response, now_ms: int) -> StateChanged | None:
        """The answer to the command that ``next_command`` named last."""
        key = (response.group, response.opcode)
        if response.status in _ABSENT and key != (Group.SESSION_CONFIG, SessionConfigOp.INIT):
            return self._set_state(None, 0) if self.state is not None else None
        if key == (Group.SESSION_CONFIG, SessionConfigOp.INIT):
            self._on_init(response, now_ms)
        elif key == (Group.SESSION_CONFIG, SessionConfigOp.SET_APP_CONFIG):
            self._on_config(response, now_ms)
        elif key == (Group.SESSION_CONTROL, SessionControlOp.START):
            self._on_start(response, now_ms)
        elif key == (Group.SESSION_CONTROL, SessionControlOp.STOP):
            if response.status == Status.OK:
                self._await(SessionState.IDLE, now_ms)
            else:  # SESSION_ACTIVE is what nodes answer when it is idle already; DEINIT settles the rest
                return self._set_state(SessionState.IDLE, 0)
        elif key == (Group.SESSION_CONFIG, SessionConfigOp.DEINIT):
            if response.status == Status.OK and self.state is not None:
                self._await(None, now_ms)
            elif self.state is not None:
                return self._set_state(None, 0)
        elif key == (Group.SESSION_CONFIG, SessionConfigOp.GET_STATE):
            return self._on_get_state(response)
        return None

    def _on_init(self, response: Response, now_ms: int) -> None:
        if response.status == Status.OK:
            self.handle = decode_init_response(response, self.session_id)
            self._configured = False
            self._await(SessionState.INIT, now_ms)
        elif response.status == Status.SESSION_DUPLICATE:
            # On some nodes the refusal has removed the old session, so try again; on others it has to be removed.
            self._duplicates += 1
            self._remove_first = self._duplicates > 1
        else:
            # The octet may have been damaged on the line, so make sure that nothing stays behind.
            self._remove_first = True
            self._refused(response)

    def _on_config(self, response: Response, now_ms: int) -> None:
        if response.status == Status.OK:
            self._configured = True
            self._await(SessionState.IDLE, now_ms)
            return
        codes = decode_config_refusal(response)
        names = {i: parameter_name(i) for i in codes}
        self._give_up(UciConfigRejectedError(response.status, names, codes))

    def _on_start(self, response: Response, now_ms: int) -> None:
        if response.status == Status.OK:
            self._await(SessionState.ACTIVE, now_ms)
        elif response.status in (Status.SESSION_ACTIVE, Status.SESSION_NOT_CONFIGURED):
            # Either it runs already (nodes use both codes for that) or it really is not configured: ask.
            self._start_refusals += 1
            if self._start_refusals >= MAX_START_REFUSALS:
                self._refused(response)
            else:
                self._verify = True
                if response.status == Status.SESSION_ACTIVE:
                    self._awaited = SessionState.ACTIVE
        else:
            self._refused(response)

    def _on_get_state(self, response: Response) -> StateChanged | None:
        octet = decode_state_response(response)
        if octet is None:
            # A node that cannot be asked accepted the command before, so take its effect as there.
            silent = response.status in _STATE_UNKNOWN and self._awaited is not self.state
            return self._set_state(self._awaited, 0) if silent else None
        try:
            state = SessionState(octet)
        except ValueError:
            return None
        actual = None if state is SessionState.DEINIT else state
        return self._set_state(actual, 0) if actual is not self.state else None

    def _await(self, state: SessionState | None, now_ms: int) -> None:
        self._awaiting = True
        self._awaited = state
        self._deadline_ms = now_ms + STATE_TIMEOUT_MS

    def _refused(self, response: Response) -> None:
        self._give_up(UciStatusError(command_name(response.group, response.opcode), response.status))

    def _give_up(self, error: UciError) -> None:
        if self.error is None:
            self.error = error
        self.wanted = False

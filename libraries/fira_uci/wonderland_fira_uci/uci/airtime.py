"""How long frames are on the air: IEEE 802.15.4z, base pulse repetition frequency (62.4 MHz on average).

A slot has to hold the longest frame and the time in which a chip turns from one to the next; a round takes as many
slots as it has frames (``config.least_slots``).
"""

from __future__ import annotations

from typing import Final

from wonderland_fira_uci.uci.config import RframeConfig, least_slots, slots_to_middle

RSTU_PER_MS: Final = 1_200
"""Ranging scheduling time units of 416 chips at 499.2 MHz."""
_CHIPS_PER_US: Final = 499.2
_SYMBOL_US: Final = 508 / _CHIPS_PER_US
"""One symbol of the preamble: 127 chips, spread by four."""
_SYNC_SYMBOLS: Final = 64
_SFD_SYMBOLS: Final = 8
_STS_US: Final = (64 + 2) * 512 / _CHIPS_PER_US
"""One segment of the scrambled sequence, with the gaps before and after it."""
_PHR_US: Final = 21 * 512 / _CHIPS_PER_US
"""19 bits and two of tail, at 0.85 Mb/s nominal."""
_BIT_US: Final = 64 / _CHIPS_PER_US
"""One coded bit of the payload, at 6.81 Mb/s nominal."""
_BLOCK_BITS: Final = 330
_PARITY_BITS: Final = 48
_TAIL_BITS: Final = 2
HEADER_OCTETS: Final = 30
"""Of a FiRa message about its data: MAC header, vendor header with session and step, integrity code, checksum."""


def frame_us(rframe: RframeConfig, data_octets: int = 0) -> float:
    """Time on the air of one ranging frame (µs), with so much data in it."""
    time_us = (_SYNC_SYMBOLS + _SFD_SYMBOLS) * _SYMBOL_US
    if rframe is not RframeConfig.SP0:
        time_us += _STS_US
    if rframe is not RframeConfig.SP3:
        bits = 8 * (HEADER_OCTETS + data_octets)
        bits += -(-bits // _BLOCK_BITS) * _PARITY_BITS + _TAIL_BITS
        time_us += _PHR_US + bits * _BIT_US
    return time_us


def slot_us(slot_duration_rstu: int) -> float:
    """Length of a slot."""
    return slot_duration_rstu * 1_000 / RSTU_PER_MS


def measured_ago_ms(responders: int, slot_duration_rstu: int) -> int:
    """From the middle of a round's measurement to its end, when nodes report it. At 10 m/s that is some 0.2 m."""
    return round((least_slots(responders) - slots_to_middle(responders)) * slot_us(slot_duration_rstu) / 1_000)

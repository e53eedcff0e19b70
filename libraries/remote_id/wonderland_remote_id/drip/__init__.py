"""DRIP: who signed a drone's broadcasts (RFC 9374 entity tags, RFC 9575 authentication formats).

It answers *who said it*, never *is it true*: a drone that signs a false position with its own key verifies here and is
refuted by the pad's measurement. Needs the extra ``drip`` (cSHAKE128 of pycryptodome).
"""

from wonderland_remote_id.drip.det import Det, DripError
from wonderland_remote_id.drip.formats import Frame, Link, Manifest, SamType, SignedEvidence, Wrapper, parse_sam
from wonderland_remote_id.drip.observer import Observation, Observer
from wonderland_remote_id.drip.pages import AuthenticationMessage, PageAssembler, paginate
from wonderland_remote_id.drip.registry import Registry

__all__ = [
    "AuthenticationMessage",
    "Det",
    "DripError",
    "Frame",
    "Link",
    "Manifest",
    "Observation",
    "Observer",
    "PageAssembler",
    "Registry",
    "SamType",
    "SignedEvidence",
    "Wrapper",
    "paginate",
    "parse_sam",
]

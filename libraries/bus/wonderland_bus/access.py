"""The router's access control: nobody may say or hear anything, but what the role of a certificate's name allows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from wonderland_bus.keys import AGENTS, ALL_OPENINGS, BACKENDS, SERVING

_SUBSCRIBE: Final = "declare_subscriber"
_LIVELINESS: Final = "declare_liveliness_subscriber"
OPENINGS_PER_S: Final = 10
"""Of one peer; the router drops what is more, so that it does not reach a backend."""
_EVERYTHING: Final = (
    "put",
    "delete",
    _SUBSCRIBE,
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


def control(agents: Sequence[str], backends: Sequence[str]) -> dict[str, Any]:
    """``access_control`` of Zenoh's configuration. Rules are of the router: ingress is what it is told."""
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    if backends:
        every_up = (ALL_OPENINGS, f"{AGENTS}/*/*/up/*")
        every_down = (f"{AGENTS}/*/*/down/*",)
        rules += [
            # Backends among themselves: everything, both ways.
            _rule("backends", _EVERYTHING, ("ingress", "egress"), (f"{BACKENDS}/**",)),
            _rule("serves", ("liveliness_token",), ("ingress",), (f"{SERVING}/*",)),
            _rule("hear-agents", (_SUBSCRIBE,), ("ingress",), every_up),
            _rule("from-agents", ("put",), ("egress",), every_up),
            _rule("tell-agents", ("put",), ("ingress",), every_down),
            _rule("agents-hear", (_SUBSCRIBE,), ("egress",), every_down),
        ]
        subjects.append(_subject("backends", backends))
        policies.append({"subjects": ["backends"], "rules": [each["id"] for each in rules]})
    for name in agents:
        own_up = (f"{AGENTS}/{name}/*/open/*", f"{AGENTS}/{name}/*/up/*")
        own = [
            _rule(f"sees:{name}", (_LIVELINESS,), ("ingress",), (f"{SERVING}/*",)),
            _rule(f"shown:{name}", ("liveliness_token",), ("egress",), (f"{SERVING}/*",)),
            _rule(f"say:{name}", ("put",), ("ingress",), own_up),
            _rule(f"heard:{name}", (_SUBSCRIBE,), ("egress",), own_up),
            _rule(f"hear:{name}", (_SUBSCRIBE,), ("ingress",), (f"{AGENTS}/{name}/*/down/*",)),
            _rule(f"told:{name}", ("put",), ("egress",), (f"{AGENTS}/{name}/*/down/*",)),
        ]
        rules += own
        subjects.append(_subject(f"agent:{name}", (name,)))
        policies.append({"subjects": [f"agent:{name}"], "rules": [each["id"] for each in own]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def few_openings() -> list[dict[str, Any]]:
    """``downsampling`` of Zenoh's configuration."""
    return [
        {
            "id": "openings",
            "messages": ["put"],
            "flows": ["ingress"],
            "rules": [{"key_expr": ALL_OPENINGS, "freq": float(OPENINGS_PER_S)}],
        }
    ]


def _rule(name: str, messages: Sequence[str], flows: Sequence[str], key_exprs: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "messages": list(messages),
        "flows": list(flows),
        "permission": "allow",
        "key_exprs": list(key_exprs),
    }


def _subject(name: str, common_names: Sequence[str]) -> dict[str, Any]:
    return {"id": name, "link_protocols": ["tls"], "cert_common_names": list(common_names)}

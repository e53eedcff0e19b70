"""A peer of ROS 2 that is none of ours (PyPI zenoh-ros2-sdk): orders as JSON lines come in, what happens goes out.

It is told texts of definitions, works out type hashes by its own means, and reads messages by its own means.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from rosbags.typesys import get_types_from_msg
from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceClient, ROS2Subscriber
from zenoh_ros2_sdk.discovery import get_service_names_and_types, get_topic_info, get_topic_names_and_types
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.utils import get_type_hash

PORT = int(sys.argv[1])
AT = {"router_ip": "127.0.0.1", "router_port": PORT, "domain_id": int(sys.argv[2])}
WHERE = {"router_ip": "127.0.0.1", "router_port": PORT}


def say(**what):
    sys.stdout.write(json.dumps(what) + "\n")  # as one: threads would print into each other's lines
    sys.stdout.flush()


def plain(value):
    if hasattr(value, "__dataclass_fields__"):
        return {name: plain(getattr(value, name)) for name in value.__dataclass_fields__ if name != "__msgtype__"}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return [plain(each) for each in value] if isinstance(value, list) else value


def known(order):
    """Definition and hash of an order's type; ``parts`` are the types within it."""
    store = ZenohSession.get_instance(**WHERE).store
    for name, text in order["parts"].items():
        if name not in store.fielddefs:
            store.register(get_types_from_msg(text, name))
    own = order["text"]
    return own, get_type_hash(order["type"], msg_definition=own, dependencies=order["parts"])


def built(kind, value):
    """The fields of a message, those that are messages made to what its serializer wants."""
    store = ZenohSession.get_instance(**WHERE).store
    types = dict(store.fielddefs[kind][1])

    def one(name, each):
        if isinstance(each, dict):
            return store.types[types[name][1]](**built(types[name][1], each))
        return np.array(each) if isinstance(each, list) and each and isinstance(each[0], float) else each

    return {name: one(name, each) for name, each in value.items()}


def main():
    held = []
    publishers = {}
    for line in sys.stdin:
        order = json.loads(line)
        match order["do"]:
            case "subscribe":
                text, type_hash = known(order)
                topic = order["topic"]

                def take(message, topic=topic):
                    say(did="message", topic=topic, message=plain(message))

                held.append(ROS2Subscriber(topic, order["type"], take, msg_definition=text, type_hash=type_hash, **AT))
                say(did="subscribe", topic=topic, hash=type_hash)
            case "advertise":
                text, type_hash = known(order)
                publishers[order["topic"]] = (
                    order["type"],
                    ROS2Publisher(order["topic"], order["type"], msg_definition=text, type_hash=type_hash, **AT),
                )
                say(did="advertise", hash=type_hash)
            case "publish":
                kind, publisher = publishers[order["topic"]]
                publisher.publish(**built(kind, order["message"]))
                say(did="publish")
            case "topics":
                say(did="topics", topics=get_topic_names_and_types(timeout=1.0, include_hidden_topics=True, **AT))
            case "services":
                say(did="services", services=get_service_names_and_types(timeout=1.0, **AT))
            case "info":
                found = get_topic_info(order["topic"], verbose=True, timeout=1.0, **AT)
                say(
                    did="info",
                    qos=[each.qos for each in found.publishers],
                    nodes=[each.node_name for each in found.publishers],
                )
            case "call":
                for name, text in order["parts"].items():
                    store = ZenohSession.get_instance(**WHERE).store
                    if name not in store.fielddefs:
                        store.register(get_types_from_msg(text, name))
                client = ROS2ServiceClient(
                    order["service"],
                    order["type"],
                    request_definition=order["request"],
                    response_definition=order["response"],
                    type_hash=order.get("hash"),
                    timeout=5.0,
                    **AT,
                )
                held.append(client)
                say(did="call", answer=plain(client.call(**order["arguments"])))


main()

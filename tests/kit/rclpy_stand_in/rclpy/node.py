from __future__ import annotations

import os
import time

import messages
from rosbags.typesys import get_types_from_msg
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber
from zenoh_ros2_sdk.session import ZenohSession
from zenoh_ros2_sdk.utils import get_type_hash

import rclpy
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

_WHERE = {"router_ip": "127.0.0.1", "router_port": int(os.environ["ROUTER_PORT"])}


def _known(kind):
    """Text and hash of a type, and the types within it made known."""
    package, _, name = kind.split("/")
    text, parts = messages.PACKAGES[package][name], messages.within(kind)
    store = ZenohSession.get_instance(**_WHERE).store
    for inner, of in parts.items():
        if inner not in store.fielddefs:
            store.register(get_types_from_msg(of, inner))
    return {"msg_definition": text, "type_hash": get_type_hash(kind, msg_definition=text, dependencies=parts)}


class _Time:
    def __init__(self):
        self.nanoseconds = time.time_ns()

    def to_msg(self):
        sec, nanosec = divmod(self.nanoseconds, 10**9)
        return messages.class_of("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)


class _Clock:
    def now(self):
        return _Time()


class Node:
    def __init__(self, name):
        self._name = name

    def get_name(self):
        return self._name

    def get_clock(self):
        return _Clock()

    def _of(self, kind, topic, qos):
        durable, depth = ("1", qos.depth) if getattr(qos, "durability", 0) == 1 else ("", getattr(qos, "depth", qos))
        return {
            "topic": f"/{topic}",
            "msg_type": kind.kind,
            "node_name": self._name,
            "domain_id": 0,
            "qos": f":{durable}:,{depth}:,:,:,,",
            **_known(kind.kind),
            **_WHERE,
        }

    def create_publisher(self, kind, topic, qos):
        return Publisher(kind.kind, ROS2Publisher(**self._of(kind, topic, qos)))

    def create_subscription(self, kind, topic, callback, qos):
        take = lambda message: rclpy._calls.put((callback, message))  # noqa: E731
        return Subscription(ROS2Subscriber(callback=take, **self._of(kind, topic, qos)))

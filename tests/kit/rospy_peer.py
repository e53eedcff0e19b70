"""A node of real rospy, told what to do by lines of JSON: /usr/bin/python3 rospy_peer.py NAME.

It runs under the system's Python, which has rospy, and knows nothing of this project. In: ``{"do": "advertise" |
"publish" | "subscribe" | "fill" | "end", "topic", "type", "hex", "latch"}``; out: one line for each thing that happened.
"""

import hashlib
import json
import random
import sys
import threading
import time

import genpy
import genpy.dynamic
import roslib.message
import rospy

_out = threading.Lock()
_made = {}


def tell(**what):
    with _out:
        print(json.dumps(what), flush=True)


def filled(kind, seed):
    """A message in which every field has some value, covariances and nested arrays too."""
    dice = random.Random(seed)

    def value_of(field_type):
        bare, array, length = _parse(field_type)
        if array:
            count = length if length is not None else dice.randint(1, 3)
            if bare in ("uint8", "char"):
                return bytes(dice.randint(0, 255) for _ in range(count))
            return [one(bare) for _ in range(count)]
        return one(bare)

    def one(bare):
        if bare == "bool":
            return dice.random() < 0.5
        if bare == "string":
            return "".join(dice.choice("abc ä") for _ in range(dice.randint(0, 9)))
        if bare == "time":
            return genpy.Time(dice.randint(0, 2**31), dice.randint(0, 999_999_999))
        if bare == "duration":
            return genpy.Duration(dice.randint(0, 2**30), dice.randint(0, 999_999_999))
        if bare in ("float32", "float64"):
            return dice.choice([0.0, -1.5, 1e300 if bare == "float64" else 1e30, float("nan"), float("inf")])
        if bare in ("byte", "int8", "int16", "int32", "int64"):
            return dice.randint(-(2**7), 2**7 - 1)
        if bare in ("char", "uint8", "uint16", "uint32", "uint64"):
            return dice.randint(0, 255)
        return message(named("std_msgs/Header" if bare == "Header" else bare))

    def message(of):
        made = of()
        for name, field_type in zip(of.__slots__, of._slot_types, strict=True):
            setattr(made, name, value_of(field_type))
        return made

    return message(kind)


def ping(publisher, order):
    """One message after the other, each when the last one has come back: (sent, back) in seconds since the epoch."""
    came = threading.Event()
    kind = publisher.data_class
    back = rospy.Subscriber(order["back"], kind, lambda _: came.set(), queue_size=10, tcp_nodelay=True)
    while order["wait"] and not back.get_num_connections():
        time.sleep(0.01)
    message, times = filled(kind, 1), []
    for _ in range(order["count"]):
        came.clear()
        sent_s = time.time()
        publisher.publish(message)
        assert came.wait(20), "no answer"
        times.append((sent_s, time.time()))
    back.unregister()
    return times


def flood(publisher, order):
    """All messages at once: seconds until the last one was published, and until the last one came back."""
    seen, done = [], threading.Event()

    def take(message):
        seen.append(message.header.frame_id)
        if len(set(seen)) == order["count"]:
            done.set()

    back = rospy.Subscriber(order["back"], publisher.data_class, take, queue_size=order["count"], tcp_nodelay=True)
    messages = [filled(publisher.data_class, 1) for _ in range(order["count"])]
    for number, message in enumerate(messages):
        message.header.frame_id = str(number)
    while order["wait"] and not back.get_num_connections():
        time.sleep(0.01)
    begun_s = time.time()
    for message in messages:
        publisher.publish(message)
    published_s = time.time() - begun_s
    assert done.wait(100), f"{len(set(seen))} of {order['count']} came back"
    back_s = time.time() - begun_s
    back.unregister()
    return {"published_s": published_s, "back_s": back_s, "twice": len(seen) - len(set(seen))}


def class_of(order):
    """The class of a type: of an installed package, or made of the definition that the order has."""
    if "definition" in order:
        _made.update(genpy.dynamic.generate_dynamic(order["type"], order["definition"]))
    return named(order["type"])


def named(kind):
    return _made.get(kind) or roslib.message.get_message_class(kind)


def _parse(field_type):
    if not field_type.endswith("]"):
        return field_type, False, None
    bare, _, length = field_type[:-1].partition("[")
    return bare, True, int(length) if length else None


def raw(message):
    import io

    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue().hex()


def main():
    publishers, subscribers = {}, []
    rospy.init_node(sys.argv[1], anonymous=False, disable_signals=True, disable_rosout=True)
    tell(did="start")
    for line in sys.stdin:
        order = json.loads(line)
        topic = order.get("topic", "")
        kind = class_of(order) if "type" in order else None
        if order["do"] == "advertise":
            publishers[topic] = rospy.Publisher(topic, kind, queue_size=10_000, latch=order.get("latch", False))
            tell(did="advertise", topic=topic)
        elif order["do"] == "wait":
            rate = rospy.Rate(200)
            while publishers[topic].get_num_connections() < order.get("count", 1):
                rate.sleep()
            tell(did="wait", topic=topic)
        elif order["do"] == "publish":
            message = publishers[topic].data_class()
            message.deserialize(bytes.fromhex(order["hex"]))
            publishers[topic].publish(message)
        elif order["do"] == "fill":
            message = filled(publishers[topic].data_class, order["seed"])
            publishers[topic].publish(message)
            tell(did="fill", topic=topic, hex=raw(message))
        elif order["do"] == "image":
            from sensor_msgs.msg import Image

            message = Image(height=1, width=order["size"], encoding="mono8", step=order["size"])
            message.data = bytes(order["size"])
            publishers[topic].publish(message)
            tell(did="image", sha256=hashlib.sha256(bytes.fromhex(raw(message))).hexdigest())
        elif order["do"] == "subscribe":
            took = lambda message, topic=topic: tell(did="message", topic=topic, hex=raw(message))  # noqa: E731
            subscribers.append(rospy.Subscriber(topic, kind, took, queue_size=10_000, tcp_nodelay=True))
            tell(did="subscribe", topic=topic)
        elif order["do"] == "ping":
            tell(did="ping", times=ping(publishers[topic], order))
        elif order["do"] == "flood":
            tell(did="flood", **flood(publishers[topic], order))
        elif order["do"] == "end":
            break
    rospy.signal_shutdown("told to end")
    tell(did="end")


main()

"""Definitions from strangers: MD5 sums as ROS has them, and texts that are meant to do harm."""

from __future__ import annotations

import contextlib
import json
import struct
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kit.ros1 import SYSTEM_PYTHON, need_ros, system_environment
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.msg import denormalize_msgtype

from wonderland_ros_bridge.errors import DefinitionError
from wonderland_ros_bridge.ros1 import definitions

NOETIC = get_typestore(Stores.ROS1_NOETIC)
TYPES = sorted(denormalize_msgtype(name) for name in NOETIC.fielddefs if not name.startswith("builtin_interfaces"))


def test_md5_sums_are_those_of_rosbags_for_all_standard_types():
    assert len(TYPES) > 100
    for kind in TYPES:
        parsed = definitions.parse(kind, definitions.standard(kind))
        assert parsed.md5 == NOETIC.gendefhash(f"{kind.replace('/', '/msg/')}", {})[1], kind


def test_md5_sums_and_definitions_are_those_of_ros_itself():
    """ROS's own texts have comments, and constants in every notation."""
    need_ros()
    program = """
import json, pathlib, roslib.message
found = []
for path in sorted(pathlib.Path(roslib.__file__).parents[1].glob("*_msgs/msg/_*.py")):
    kind = f"{path.parts[-3]}/{path.stem[1:]}"
    of = roslib.message.get_message_class(kind)
    if of is not None:
        found.append([kind, of._full_text, of._md5sum])
print(json.dumps(found))
"""
    done = subprocess.run(
        [SYSTEM_PYTHON, "-c", program], capture_output=True, env=system_environment(), check=True, timeout=60
    )
    found = json.loads(done.stdout)
    assert len(found) > 60
    for kind, text, md5 in found:
        assert definitions.parse(kind, text).md5 == md5, kind
        definitions.Codec(definitions.parse(kind, text))


CHAIN = "C[1024] c\n" + "".join(
    f"{'=' * 80}\nMSG: a/{one}\n{of}[1024] x\n" for one, of in (("C", "D"), ("D", "E"), ("E", "int8"))
).replace("int8[1024] x", "int8 x")


@pytest.mark.parametrize(
    ("kind", "text", "says"),
    [
        ("a/B", "a/B again\n", "part of itself"),
        ("a/B", f"C c\n{'=' * 80}\nMSG: a/C\nB b\n", "part of itself"),
        ("a/B", "C c\n", "does not say what a/C is"),
        ("a/B", "string[100000000] x\n", "more than 1024 elements"),
        ("a/B", "string[1000000000] x\n", "no field"),
        ("a/B", "uint8[70000] x\n", "more than 65536 elements"),
        ("a/B", "uint8[99999999999] x\n", "no field"),
        ("a/B", "int32 x\nint32 x\n", "one name"),
        ("a/B", "int32 x; import os\n", "no field"),
        ("a/B", "int32 __class__\n", "no field"),
        ("a/B", "import_os x = 1\n", "no constant"),
        ("a/B", "x" * 200_000, "200000 characters"),
        ("a/B", "\n".join(f"int8 a{i}" for i in range(3_000)), "more than 2000 fields"),
        ("a/B", f"C[] c\n{'=' * 80}\nMSG: a/C\n", "which has no fields"),
        ("a/B", f"C[3] c\n{'=' * 80}\nMSG: a/C\nint8 X=1\n", "which has no fields"),
        ("a/B", CHAIN, "at least 1073741824 bytes"),
        ("a/B\nint32 x", "int32 y\n", "no type of message"),
        ("a/B", f"int8 x\n{'=' * 80}\nint8 y\n", "not MSG"),
    ],
)
def test_a_definition_that_would_do_harm_is_refused(kind, text, says):
    with pytest.raises(DefinitionError, match=says):
        definitions.parse(kind, text)


def test_a_long_chain_of_types_is_refused():
    text = "A0 a\n" + "".join(f"{'=' * 80}\nMSG: p/A{i}\nA{i + 1} a\n" for i in range(60))
    with pytest.raises(DefinitionError, match="more than 24 deep"):
        definitions.parse("p/B", text)


def test_constants_and_keywords_do_not_reach_the_generated_code():
    text = 'string CODE=__import__("os").system("false") # kept\nint32 lambda\nint32 class\n'
    codec = definitions.codec("a/B", text)
    assert codec.to_json(struct.pack("<ii", 3, 4)) == {"lambda": 3, "class": 4}


@pytest.mark.parametrize(
    "data",
    [b"", b"\xff\xff\xff\xff", b"\x05\x00\x00\x00abc", b"\x01\x00\x00\x00ab", b"\x01\x00\x00\x00\xff"],
    ids=["empty", "huge length", "cut off", "too long", "no UTF-8"],
)
def test_bytes_that_are_no_message_are_refused(data):
    with pytest.raises(DefinitionError, match=r"are no std_msgs/String"):
        definitions.codec("std_msgs/String", "string data\n").decode(data)


WORDS = st.sampled_from(
    ["int8", "string", "Header", "a/B", "C", "x", "=", "[", "]", "[3]", "#", "\n", " ", "=" * 80, "MSG: a/C", "\0", "ä"]
)


@given(st.lists(WORDS, max_size=30).map("".join) | st.text(max_size=80))
def test_any_text_is_a_definition_or_refused(text):
    with contextlib.suppress(DefinitionError):
        definitions.Codec(definitions.parse("a/B", text))


IMU = definitions.codec("sensor_msgs/Imu", definitions.standard("sensor_msgs/Imu"))
CLOUD = definitions.codec("sensor_msgs/PointCloud2", definitions.standard("sensor_msgs/PointCloud2"))


@given(st.binary(max_size=400))
def test_any_bytes_are_a_message_or_refused(data):
    for codec in (IMU, CLOUD):
        with contextlib.suppress(DefinitionError):
            codec.to_json(data)

"""ROS 2 bags in the format MCAP: joint states as a table."""

from __future__ import annotations

import io
from itertools import chain
from typing import Any

import numpy as np

from npend_gym._extras import require
from npend_gym.identification.tables import Column, Table

_TYPE, _USUAL = "sensor_msgs/msg/JointState", "/joint_states"


def read_bag(*files: bytes) -> Table:
    """Return the joint states of a bag: positions by the names of joints, velocities, efforts.

    The bag may be split into several files. Instants are stamps of the headers, from the first one
    on; those of the log where headers have none. Positions are angles of joints. Cells that a
    message leaves out are NaN.

    Raises
    ------
    ValueError
        If the file is damaged, or has no joint states, or several topics of them.
    ImportError
        If the extra "ros" is not installed.
    """
    reader = require("mcap.reader", "ros", "ROS bags")
    factory: Any = require("mcap_ros2.decoder", "ros", "ROS bags").DecoderFactory()
    topics, others = dict[str, list[tuple[int, Any]]](), set[str]()
    try:
        messages = (reader.make_reader(io.BytesIO(data)).iter_messages() for data in files)
        for schema, channel, message in chain.from_iterable(messages):
            decode = factory.decoder_for(channel.message_encoding, schema)
            if decode is not None and schema.name == _TYPE:
                states = topics.setdefault(channel.topic, [])
                states.append((message.log_time, decode(message.data)))
            else:
                others.add(channel.topic)
    except Exception as error:
        raise ValueError(
            f"the ROS bag is damaged, or was not closed ({error!r}): mcap recover repairs it"
        ) from error
    topic = _USUAL if _USUAL in topics else min(topics, default="")
    if not topics or (topic != _USUAL and len(topics) > 1):
        names = ", ".join(sorted(topics or others)) or "no messages"
        raise ValueError(
            f"the ROS bag must have one topic of {_TYPE}, as ROS 2 writes them, or {_USUAL} among "
            f"several, got {names}: record it alone, or keep it with mcap filter --include-topic"
        )
    return _table(topic, topics[topic])


def _table(topic: str, states: list[tuple[int, Any]]) -> Table:
    """Return the columns of messages, each with the instant of its log [ns]."""
    logged = np.array([log for log, _ in states])
    headers = [message.header.stamp for _, message in states]
    stamped = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in headers])
    name, instants = ("header.stamp", stamped) if stamped.all() else ("log time", logged)
    order = np.argsort(instants, kind="stable")
    seconds = (instants[order] - instants[order[0]]) * 1e-9
    columns = [Column(name, seconds, role="time")]
    joints = [*dict.fromkeys(joint for _, message in states for joint in message.name)]
    for k, joint in enumerate(joints):
        for field, suffix, role in (
            ("position", "", f"relative{k}"),
            ("velocity", ".velocity", "other"),
            ("effort", ".effort", f"tau{k}"),
        ):
            cells = (dict(zip(m.name, getattr(m, field), strict=False)) for _, m in states)
            values = np.array([cell.get(joint, np.nan) for cell in cells])[order]
            if not np.isnan(values).all():  # a joint without effort reports NaN
                columns.append(Column(joint + suffix, values, role=role))
    return Table(f"a ROS bag, topic {topic}", columns)

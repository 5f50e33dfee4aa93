"""Read the calibration in a bag: CameraInfo messages beside the events."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_typestore

from gpvo.errors import InputError
from gpvo.recordings.bags.message_log import MessageLog
from gpvo.recordings.calibration.camera_info import EXPECTED, camera_info_rig, is_rectified_pair
from gpvo.recordings.calibration.fields import Fields
from gpvo.recordings.calibration.rig import StereoRig
from gpvo.recordings.streams import Faults

MESSAGE = "sensor_msgs/CameraInfo"


def camera_info_of_log(log: MessageLog, left: str, right: str) -> StereoRig | None:
    """Return the rig of the camera_info topics beside two event topics, or None."""
    names = [f"{topic.rpartition('/')[0]}/camera_info" for topic in (left, right)]
    if names[0] == names[1] or any(name not in log.topics for name in names):
        return None
    left_info, right_info = (_message_fields(log, name) for name in names)
    if left_info is None or right_info is None or not is_rectified_pair(left_info, right_info):
        return None
    return camera_info_rig(left_info, right_info)


def _message_fields(log: MessageLog, name: str) -> Fields | None:
    """Return the first CameraInfo of a topic with the field names of the YAML files."""
    topic = log.topics[name]
    raw = next(log.messages(name, Faults()), None)
    if raw is None or topic.type != MESSAGE:
        return None
    ros1 = topic.encoding == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    deserialise = store.deserialize_ros1 if ros1 else store.deserialize_cdr
    try:
        info: Any = deserialise(bytes(raw), "sensor_msgs/msg/CameraInfo")
    except Exception as error:  # rosbags raises many kinds of errors for damaged bytes
        raise InputError(f"{log.path}: {name} is damaged; give --calibration") from error
    upper = {letter: getattr(info, letter, getattr(info, letter.lower(), ())) for letter in "DKRP"}
    return Fields(log.path, name, _yaml_names(info, upper), EXPECTED)


def _yaml_names(info: Any, arrays: dict[str, Any]) -> dict[str, Any]:
    return {
        "image_width": info.width,
        "image_height": info.height,
        "distortion_model": info.distortion_model,
        "camera_matrix": {"data": arrays["K"]},
        "distortion_coefficients": {"data": arrays["D"]},
        "rectification_matrix": {"data": arrays["R"]},
        "projection_matrix": {"data": arrays["P"]},
    }

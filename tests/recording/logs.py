"""A run as loggers write it: NMEA 0183, bags of ROS, MAT 7.3, Excel."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from manoeuvre_nn.core.frames import body_to_earth
from manoeuvre_nn.core.recording import Recording
from manoeuvre_nn.core.units import DEGREE, KNOT

MIDNIGHT = pd.Timestamp("2020-07-31T23:57:00")
"""When logs begin: they pass midnight, and the end of a month."""
LATITUDE, LONGITUDE = 43.0, -5.0
"""Where they begin [deg]."""
METRES = 111109.0, 81541.0
"""Metres of a degree of latitude and longitude there."""
D = 1 / DEGREE


def sentence(words: str) -> str:
    """A sentence with its checksum: letter by letter, unlike the reader."""
    made = 0
    for letter in words:
        made ^= ord(letter)
    return f"${words}*{made:02X}"


def degrees(value: float, digits: int, hemispheres: str) -> str:
    """Degrees and minutes ``ddmm.mmmmmm`` and hemisphere."""
    whole, minutes = divmod(abs(value) * 60, 60)
    return f"{int(whole):0{digits}d}{minutes:09.6f},{hemispheres[value < 0]}"


def placed(run: Recording) -> pd.DataFrame:
    """What instruments of a ship show, at the times of the run."""
    north, east = body_to_earth(run["u"], run["v"], run["psi"])
    return pd.DataFrame({
        "t": run.time,
        "lat": LATITUDE + run["x"] / METRES[0], "lon": LONGITUDE + run["y"] / METRES[1],
        "sog": np.hypot(north, east) / KNOT, "cog": np.mod(np.arctan2(east, north) * D, 360),
        "hdg": np.mod(run["psi"] * D, 360), "rot": run["r"] * D * 60, "rudder": -run["delta"] * D,
        "u": run["u"] / KNOT, "v": run["v"] / KNOT,
    })  # fmt: skip


def sentences(row, now: pd.Timestamp) -> list[str]:
    """What a ship's instruments say at one time."""
    clock, date = now.strftime("%H%M%S.%f")[:9], now.strftime("%d%m%y")
    place = f"{degrees(row.lat, 2, 'NS')},{degrees(row.lon, 3, 'EW')}"
    return [
        sentence(f"GPRMC,{clock},A,{place},{row.sog:.5f},{row.cog:.5f},{date},,,A"),
        sentence(f"HEHDT,{row.hdg:.4f},T"),
        sentence(f"HEROT,{row.rot:.5f},A"),
        sentence(f"AGRSA,{row.rudder:.5f},A,,"),
        sentence(f"VDVBW,{row.u:.4f},{row.v:.4f},A,{row.u:.6f},{row.v:.6f},A,,V,,V"),
        sentence("ERRPM,S,0,84.5,10.0,A"),
        sentence("WIMWV,045.0,R,10.0,N,A"),
    ]


def write_nmea(path: Path, run: Recording, stamp: str | None = None, rows: Iterable | None = None) -> Path:
    """A log of one burst a sample; ``stamp`` is how the logger writes times: a format of strftime, or none."""
    lines = []
    for row in rows if rows is not None else placed(run).itertuples():
        now = MIDNIGHT + pd.Timedelta(seconds=row.t)
        lines += [(now.strftime(stamp) if stamp else "") + one for one in sentences(row, now)]
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def ros(run: Recording) -> pd.DataFrame:
    """As REP 103 has it: x east, y north, z up; x ahead, y to port."""
    yaw = np.pi / 2 - run["psi"]
    return pd.DataFrame({
        "t": run.time, "east": run["y"], "north": run["x"], "qz": np.sin(yaw / 2), "qw": np.cos(yaw / 2),
        "ahead": run["u"], "to_port": -run["v"], "turning_left": -run["r"], "rudder": run["delta"],
    })  # fmt: skip


def write_bag(path: Path, run: Recording, frame: str = "map", receive_delay: float = 0.0) -> Path:
    """A bag with an odometry topic and a custom message of the rudder: ROS 1 for .bag, else a folder of ROS 2."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    older = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if older else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("std_msgs/Header header\nfloat64 angle\nstring note\n", "my_ship/msg/Steering"))
    kinds = {"/odom": "nav_msgs/msg/Odometry", "/rudder": "my_ship/msg/Steering", "/note": "std_msgs/msg/String"}
    plugin = StoragePlugin.MCAP if path.name.endswith("mcap") else StoragePlugin.SQLITE3
    writing = Writer1(path) if older else Writer(path, version=9, storage_plugin=plugin)
    t = store.types
    with writing as bag:
        links = {topic: bag.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for row in ros(run).itertuples():
            nanoseconds = int(MIDNIGHT.value + round(row.t * 1e9))
            stamp = t["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            words = {"seq": 0} if older else {}
            header = t["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **words)
            vector, zeros = t["geometry_msgs/msg/Vector3"], np.zeros(36)
            pose = t["geometry_msgs/msg/Pose"](
                t["geometry_msgs/msg/Point"](row.east, row.north, 0.0),
                t["geometry_msgs/msg/Quaternion"](0.0, 0.0, row.qz, row.qw),
            )
            twist = t["geometry_msgs/msg/Twist"](
                vector(row.ahead, row.to_port, 0.0), vector(0.0, 0.0, row.turning_left)
            )
            odometry = t["nav_msgs/msg/Odometry"](
                header, "base_link", t["geometry_msgs/msg/PoseWithCovariance"](pose, zeros),
                t["geometry_msgs/msg/TwistWithCovariance"](twist, zeros),
            )  # fmt: skip
            messages = {"/odom": odometry, "/rudder": t["my_ship/msg/Steering"](header, row.rudder, "as ordered"),
                        "/note": t["std_msgs/msg/String"]("calm")}  # fmt: skip
            for topic, message in messages.items():
                serialize = store.serialize_ros1 if older else store.serialize_cdr
                bag.write(links[topic], nanoseconds + int(receive_delay * 1e9), serialize(message, kinds[topic]))
    return path


def write_sensors(path: Path, run: Recording) -> Path:
    """A bag of ROS 1 with a receiver and its velocity to east and north at 1 Hz, an IMU and a rudder [deg] at 2 Hz."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    t, nine = store.types, np.zeros(9)
    kinds = {"/fix": "sensor_msgs/msg/NavSatFix", "/vel": "geometry_msgs/msg/TwistStamped",
             "/imu": "sensor_msgs/msg/Imu", "/rudder_angle": "std_msgs/msg/Float64"}  # fmt: skip
    table, north_east = ros(run), body_to_earth(run["u"], run["v"], run["psi"])
    table["yaw"], table["to_north"], table["to_east"] = np.pi / 2 - run["psi"], *north_east
    table["lat"], table["lon"] = placed(run)["lat"], placed(run)["lon"]
    vector = t["geometry_msgs/msg/Vector3"]
    with Writer(path) as bag:
        links = {topic: bag.add_connection(topic, kind, typestore=store) for topic, kind in kinds.items()}
        for k, now in enumerate(np.arange(0.0, run.time[-1], 0.5)):
            at = {name: float(np.interp(now, run.time, table[name])) for name in table}
            nanoseconds = int(MIDNIGHT.value + round(now * 1e9))
            stamp = t["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            header = t["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="imu_link")
            turn = t["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(at["yaw"] / 2), np.cos(at["yaw"] / 2))
            rate, pull = vector(0.0, 0.0, at["turning_left"]), vector(0.0, 0.0, 9.8)
            said = {"/imu": t["sensor_msgs/msg/Imu"](header, turn, nine, rate, nine, pull, nine),
                    "/rudder_angle": t["std_msgs/msg/Float64"](at["rudder"] * D)}  # fmt: skip
            if k % 2 == 1:
                fix = t["sensor_msgs/msg/NavSatStatus"](-1 if k == 7 else 0, 1)
                over = t["geometry_msgs/msg/Twist"](vector(at["to_east"], at["to_north"], 0.0), vector(0.0, 0.0, 0.0))
                said["/fix"] = t["sensor_msgs/msg/NavSatFix"](header, fix, at["lat"], at["lon"], 0.0, nine, 0)
                said["/vel"] = t["geometry_msgs/msg/TwistStamped"](header, over)
            for topic, message in said.items():
                bag.write(links[topic], nanoseconds, store.serialize_ros1(message, kinds[topic]))
    return path


def write_mat73(path: Path, columns: dict[str, np.ndarray], structure: str = "") -> Path:
    """As save(file, "-v7.3") writes it: an HDF5 file behind 512 bytes, columns of MATLAB as rows."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group(structure) if structure else file
        for name, values in columns.items():
            group.create_dataset(name, data=np.atleast_2d(values), compression="gzip").attrs["MATLAB_class"] = (
                np.bytes_("double")
            )
        text = file.create_dataset("note", data=np.array([[ord(letter)] for letter in "calm"], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")
    return path

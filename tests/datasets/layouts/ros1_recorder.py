"""Writes a bag with the `rosbag` module of ROS 1, a program that runs alone.

Arguments: the folder of the packages of ROS, the bag, its compression, and a `.npz` file with times
(N,) in ns, rgb (N, H, W, 3), metres (N, H, W) float32, positions (N, 3), and quaternions (N, 4) in
order x, y, z, w.
"""

import sys

import numpy as np

sys.path.append(sys.argv[1])
import genpy
import rosbag
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import CameraInfo, Image


def main(target, compression, source):
    data = np.load(source)
    with rosbag.Bag(target, "w", compression=compression, chunk_threshold=4096) as bag:
        for row, nanoseconds in enumerate(data["times"]):
            stamp = genpy.Time(int(nanoseconds) // 10**9, int(nanoseconds) % 10**9)
            height, width = data["rgb"].shape[1:3]
            for topic, encoding, pixels in (
                ("/camera/color/image_raw", "bgr8", data["rgb"][row][..., ::-1]),
                ("/camera/depth/image_rect", "32FC1", data["metres"][row]),
            ):
                content = np.ascontiguousarray(pixels).tobytes()
                image = Image(
                    height=height, width=width, encoding=encoding,
                    step=len(content) // height, data=content,
                )  # fmt: skip
                image.header.stamp, image.header.frame_id = stamp, "/camera_optical"
                bag.write(topic, image, stamp)
            info = CameraInfo(height=height, width=width, distortion_model="plumb_bob")
            info.K = [20.0, 0.0, 11.5, 0.0, 21.0, 7.5, 0.0, 0.0, 1.0]
            info.header.stamp = stamp
            bag.write("/camera/color/camera_info", info, stamp)
            pose = PoseStamped()
            pose.header.stamp, pose.header.frame_id = stamp, "map"
            position, rotation = pose.pose.position, pose.pose.orientation
            position.x, position.y, position.z = data["positions"][row].tolist()
            rotation.x, rotation.y, rotation.z, rotation.w = data["quaternions"][row].tolist()
            bag.write("/pose", pose, stamp)


if __name__ == "__main__":
    main(*sys.argv[2:])

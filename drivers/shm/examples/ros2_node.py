#!/usr/bin/env python3
"""A node of ROS 2 that publishes a stream's sharp frames: where image and work belong into one process. Otherwise
[ros2] enable = true in bolod's configuration does this without a node. Not tried with ROS 2 here: Debian has none.

usage: ros2_node.py NAME
"""

import sys

import bolo
import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image


class Frames(Node):
    def __init__(self, name):
        super().__init__("bolo")
        self.camera = bolo.Camera(name, timeout=None)
        self.publisher = self.create_publisher(Image, f"{name}/image_deblurred", qos_profile_sensor_data)
        self.create_timer(0.0, self.publish)

    def publish(self):
        frame = self.camera.next(timeout=0.1)
        if frame is None:
            return
        image = Image(height=frame.deblurred.shape[0], width=frame.deblurred.shape[1], encoding="mono16")
        image.step, image.data = 2 * image.width, frame.deblurred.tobytes()
        image.header.frame_id = "thermal"
        image.header.stamp.sec, image.header.stamp.nanosec = divmod(frame.utc_ns or 0, 10**9)
        if frame.valid():  # else it was overwritten while it was copied
            self.publisher.publish(image)


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(Frames(sys.argv[1]))

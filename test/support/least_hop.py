"""The least that a hop between two nodes costs in rclpy: python test/support/least_hop.py

Bytes of the size of the graph's messages go through a chain of processes, each of which publishes what it
takes as it is: no message is made or read, no stage runs. Executor, Fast DDS profile and QoS are the graph's.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import time

import numpy as np
import rclpy

from panoptic_ros.graph.flow import make_flow
from panoptic_ros.nodes.middleware.family import message_class
from panoptic_ros.nodes.middleware.quality import data_quality
from panoptic_ros.nodes.middleware.runtime import SWITCH_S, make_executor, start_ros
from panoptic_ros.running.processes.children import child_environment, prepare_environment

KIND = message_class("std_msgs/msg/UInt8MultiArray")
SETTLE_S = 3.0  # until all have found each other
HEADER = bytes([0, 1, 0, 0]) + bytes(8)  # of the message: plain CDR, an empty layout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--relays", type=int, default=5)
    parser.add_argument("--bytes", type=int, default=60_000)
    parser.add_argument("--rate", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--relay", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    prepare_environment()
    if args.relay is not None:
        relay(args)
        return
    own = [sys.executable, __file__, *sys.argv[1:]]
    children = [
        subprocess.Popen([*own, "--relay", str(k)], env=child_environment(), stdout=subprocess.PIPE)
        for k in range(args.relays)
    ]
    latencies = feed(args)
    used = [float(child.communicate()[0]) for child in children]
    hops = args.relays + 1
    p50, p99 = np.percentile(latencies, (50, 99))
    print(
        f"{args.bytes} bytes over {hops} hops at {args.rate:g} Hz: p50 {p50:.2f} ms, p99 {p99:.2f} ms, "
        f"{p50 / hops:.2f} ms a hop; a relay takes {np.mean(used):.2f} ms of processor time; "
        f"load {os.getloadavg()[0]:.1f}"
    )


def relay(args: argparse.Namespace) -> None:
    """Publish what comes, and print the processor time of each message (ms)."""
    node, executor = begin(f"relay_{args.relay}")
    publisher = node.create_publisher(KIND, f"hop_{args.relay + 1}", data_quality(make_flow("live")))
    times: list[float] = []

    def take(data: bytes) -> None:
        publisher.publish(data)
        times.append(cpu_s())

    node.create_subscription(KIND, f"hop_{args.relay}", take, data_quality(make_flow("live")), raw=True)
    end = time.monotonic() + args.seconds + 3.0 * SETTLE_S
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.2)
    print(1e3 * (times[-1] - times[0]) / (len(times) - 1), flush=True)
    os._exit(0)


def feed(args: argparse.Namespace) -> list[float]:
    """Publish at the rate; ms until it has come through."""
    node, executor = begin("feeder")
    latencies: list[float] = []

    def take(data: bytes) -> None:
        latencies.append(1e-6 * (time.monotonic_ns() - int.from_bytes(data[-8:], "little")))

    publisher = node.create_publisher(KIND, "hop_0", data_quality(make_flow("live")))
    node.create_subscription(KIND, f"hop_{args.relays}", take, data_quality(make_flow("live")), raw=True)
    filler = HEADER + args.bytes.to_bytes(4, "little") + bytes(args.bytes - 8)
    due = time.monotonic() + SETTLE_S
    for _ in range(round(args.rate * args.seconds)):
        while (left := due - time.monotonic()) > 0:
            executor.spin_once(timeout_sec=left)
        publisher.publish(filler + time.monotonic_ns().to_bytes(8, "little"))
        due += 1.0 / args.rate
    until = time.monotonic() + 1.0
    while time.monotonic() < until:
        executor.spin_once(timeout_sec=0.1)
    return latencies[len(latencies) // 10 :]


def begin(name: str) -> tuple[rclpy.node.Node, rclpy.executors.Executor]:
    sys.setswitchinterval(SWITCH_S)
    start_ros([])
    node, executor = rclpy.create_node(name), make_executor()
    executor.add_node(node)
    return node, executor


def cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()

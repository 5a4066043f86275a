# SPDX-License-Identifier: Apache-2.0
"""What Foxglove and Lichtblick see: the protocol foxglove.sdk.v1, github.com/foxglove/foxglove-sdk."""

import asyncio
import json
import socket
import struct
import subprocess
from concurrent.futures import ThreadPoolExecutor

import aiohttp
from command_line import REGISTA, environment
from gateway import Gateway

MESSAGE_DATA = 1  # binary opcode: uint32 subscription, uint64 log time [ns], payload; little-endian


async def first_message(url, topic):
    """The channel of the topic, as it is advertised, and its first message."""
    async with aiohttp.ClientSession() as session, session.ws_connect(url, protocols=["foxglove.sdk.v1"]) as client:
        assert client.protocol == "foxglove.sdk.v1"
        found, info = None, None
        async for message in client:
            if message.type is aiohttp.WSMsgType.TEXT:
                said = json.loads(message.data)
                info = said if said["op"] == "serverInfo" else info
                for channel in said.get("channels", []) if said["op"] == "advertise" else []:
                    if channel["topic"] == topic:
                        found = channel
                        subscription = {"id": 7, "channelId": channel["id"]}
                        await client.send_json({"op": "subscribe", "subscriptions": [subscription]})
            elif message.type is aiohttp.WSMsgType.BINARY and message.data[0] == MESSAGE_DATA:
                subscription, nanoseconds = struct.unpack_from("<IQ", message.data, 1)
                assert subscription == 7
                return info, found, nanoseconds, json.loads(message.data[13:])


def test_foxglove_reads_what_the_robot_says(robot, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    gateway = Gateway(robot.robot, folder=tmp_path, options=("--foxglove", str(port)))
    try:
        topic = f"/127.0.0.1_{robot.port}/power/0/state"
        talk = first_message(f"ws://127.0.0.1:{port}", topic)
        with ThreadPoolExecutor() as threads:  # the driver of the browser has an event loop on this one
            info, channel, nanoseconds, message = threads.submit(asyncio.run, asyncio.wait_for(talk, 60)).result()
    finally:
        gateway.end()
    assert info["name"] == "regista"
    assert "clientPublish" not in info["capabilities"]
    assert (channel["encoding"], channel["schemaName"], channel["schemaEncoding"]) == (
        "json",
        "regista.power.State",
        "jsonschema",
    )
    assert json.loads(channel["schema"])["properties"]["voltage_v"]["type"] == "number"
    assert message["voltage_v"] > 10
    assert nanoseconds > 1.7e18


def test_without_the_package_or_with_a_taken_port_it_says_what_to_do(tmp_path):
    (tmp_path / "foxglove.py").write_text("raise ModuleNotFoundError('foxglove')\n")
    command = [*REGISTA, "teleop", "--no-browser", "--foxglove"]
    done = subprocess.run(
        [*command, "0"], env=environment(PYTHONPATH=str(tmp_path)), capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1 and "pip install 'regista[foxglove]'" in done.stderr
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        done = subprocess.run([*command, str(port)], env=environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 1 and f"127.0.0.1:{port}" in done.stderr and "--foxglove" in done.stderr

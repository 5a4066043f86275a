# SPDX-License-Identifier: Apache-2.0
"""A CiA 402 drive in profile velocity mode on python-canopen: a slave that shares no code with ours.

drive.py --interface socketcand|socketcan --channel BUS [--port PORT] [--node 5]... [--eds FILE] [--report SECONDS]
         [--no-blocks]

Boot-up, heartbeat both ways (1016, 1017), SDO of all kinds, PDOs mapped by SDO, SYNC, EMCY; no LSS. Without set-points
for the time of 1400:05, or without the heartbeat of the master, it does what 6007 says: 0 nothing, 1 fault, 2 disable,
3 quick stop. Writing 2002 raises that error. Each change is a line of JSON on stdout; the first line is "ready". With
--report it also tells every so often how far its motor has turned.
"""

import argparse
import json
import struct
import threading
import time
from pathlib import Path

import can
from block_server import BlockSdoServer

import canopen

STATES = {
    "not ready to switch on": 0x00,
    "switch on disabled": 0x40,
    "ready to switch on": 0x21,
    "switched on": 0x23,
    "operation enabled": 0x27,
    "quick stop active": 0x07,
    "fault reaction active": 0x0F,
    "fault": 0x08,
}
COAST = 2000  # [rpm/s], without torque
BEAT = 0.005  # [s]


class Drive:
    def __init__(self, network, node_id, eds, report=None, blocks=True):
        self.network = network
        self.report = report  # [s]
        self.id = node_id
        self.lock = threading.RLock()
        self.state = "switch on disabled"
        self.controlword = 0
        self.speed = 0.0
        self.turns = 0.0
        self.pdos = {"receive": {}, "transmit": []}
        self.changed = False
        self.consumed = None  # (node, last heard)
        self.node = canopen.LocalNode(node_id, str(eds))
        if blocks:
            self.node.sdo = BlockSdoServer(0x600 + node_id, 0x580 + node_id, self.node)
        self.node.add_write_callback(self.on_write)
        self.node.add_read_callback(self.on_read)
        network.add_node(self.node)
        network.subscribe(0x000, self.on_nmt)
        network.subscribe(0x080, self.on_sync)
        self.node.nmt.send_command(0)
        self.node.nmt.send_command(128)
        self.nmt = self.node.nmt.state
        self.load_pdos()
        threading.Thread(target=self.run, daemon=True).start()

    # --- the dictionary

    def variable(self, index, sub=0):
        found = self.node.object_dictionary[index]
        return found if isinstance(found, canopen.objectdictionary.ODVariable) else found[sub]

    def get(self, index, sub=0):
        return self.variable(index, sub).decode_raw(self.node.get_data(index, sub))

    def put(self, index, value, sub=0):
        self.node.data_store.setdefault(index, {})[sub] = self.variable(index, sub).encode_raw(value)

    def on_read(self, index, subindex, od):
        match index:
            case 0x6041:
                return self.statusword()
            case 0x606C:
                return int(self.speed)
            case 0x6061:
                return self.get(0x6060)
        return None

    def on_write(self, index, subindex, od, data):
        if index == 0x6040:
            self.control(struct.unpack("<H", data)[0])
        elif index == 0x2002 and any(data):
            self.fault(struct.unpack("<H", data)[0])
        elif index == 0x2010:
            self.say(counter=struct.unpack("<I", data)[0])
        elif 0x1400 <= index < 0x1C00:
            self.changed = True  # it is stored after this callback

    # --- CiA 402

    def statusword(self):
        word = STATES[self.state] | 0x210
        if self.state in ("ready to switch on", "switched on", "operation enabled"):
            word |= 0x20
        if self.state == "operation enabled" and abs(self.speed - self.get(0x60FF)) < 1:
            word |= 0x400
        return word | (0x1000 if abs(self.speed) < 1 else 0)

    def go(self, state):
        if state != self.state:
            self.state = state
            self.say(state=state)

    def control(self, word):
        with self.lock:
            rising = word & ~self.controlword
            self.controlword = word
            if self.state == "fault":
                if rising & 0x80:
                    self.emergency(0)
                    self.go("switch on disabled")
            elif self.state == "fault reaction active":
                pass
            elif not word & 0x02:
                self.go("switch on disabled")
            elif not word & 0x04:
                stops = self.state in ("operation enabled", "quick stop active")
                self.go("quick stop active" if stops else "switch on disabled")
            elif word & 0x07 == 0x06:
                if self.state != "quick stop active":
                    self.go("ready to switch on")
            elif word & 0x0F == 0x07:
                self.go(
                    {"ready to switch on": "switched on", "operation enabled": "switched on"}.get(
                        self.state, self.state
                    )
                )
            elif word & 0x0F == 0x0F and self.state in ("ready to switch on", "switched on", "quick stop active"):
                self.go("operation enabled")

    def fault(self, code):
        with self.lock:
            self.emergency(code)
            self.go("fault reaction active" if self.state in ("operation enabled", "quick stop active") else "fault")

    def emergency(self, code):
        register = 0x11 if code else 0
        self.put(0x1001, register)
        self.put(0x603F, code)
        if code:
            older = [self.get(0x1003, sub) for sub in range(1, 8)]
            for sub, value in enumerate([code, *older], 1):
                self.put(0x1003, value, sub)
            self.put(0x1003, min(8, self.get(0x1003, 0) + 1), 0)
        self.node.emcy.send(code, register)
        self.say(emcy=code)

    def silence(self, code):
        self.say(silent=code)
        if self.state != "operation enabled":
            self.emergency(code)
            return
        match self.get(0x6007):
            case 1:
                self.fault(code)
            case 2:
                self.emergency(code)
                self.go("switch on disabled")
            case 3:
                self.emergency(code)
                self.go("quick stop active")

    # --- communication

    def load_pdos(self):
        with self.lock:
            self.changed = False
            for cob_id in self.pdos["receive"]:
                self.network.unsubscribe(cob_id, self.on_rpdo)
            receive, transmit = {}, []
            for parameters in [*range(0x1400, 0x1404), *range(0x1800, 0x1804)]:
                cob_id = self.get(parameters, 1)
                if cob_id & 0x80000000:
                    continue
                mapping = parameters + 0x200
                codes = [self.get(mapping, sub) for sub in range(1, self.get(mapping, 0) + 1)]
                pdo = {
                    "id": cob_id & 0x7FF,
                    "type": self.get(parameters, 2),
                    "timer": self.get(parameters, 5) / 1000,
                    "objects": [(code >> 16, code >> 8 & 0xFF, (code & 0xFF) // 8) for code in codes],
                    "due": None,
                    "sent": None,
                    "pending": None,
                    "syncs": 0,
                }
                if parameters < 0x1800:
                    receive[pdo["id"]] = pdo
                else:
                    transmit.append(pdo)
            self.pdos = {"receive": receive, "transmit": transmit}
            for cob_id in receive:
                self.network.subscribe(cob_id, self.on_rpdo)

    def on_rpdo(self, cob_id, data, timestamp):
        with self.lock:
            pdo = self.pdos["receive"].get(cob_id)
            if pdo is None or self.nmt != "OPERATIONAL":
                return
            if len(data) < sum(size for *_, size in pdo["objects"]):
                self.emergency(0x8210)
                return
            if pdo["timer"]:
                pdo["due"] = time.monotonic() + pdo["timer"]
            if pdo["type"] <= 240:
                pdo["pending"] = bytes(data)
            else:
                self.apply(pdo, bytes(data))

    def apply(self, pdo, data):
        for index, sub, size in pdo["objects"]:
            self.node.set_data(index, sub, data[:size])
            data = data[size:]

    def on_sync(self, cob_id, data, timestamp):
        with self.lock:
            if self.nmt != "OPERATIONAL":
                return
            for pdo in self.pdos["receive"].values():
                if pdo["pending"] is not None:
                    self.apply(pdo, pdo["pending"])
                    pdo["pending"] = None
            for pdo in self.pdos["transmit"]:
                if 1 <= pdo["type"] <= 240:
                    pdo["syncs"] = (pdo["syncs"] + 1) % pdo["type"]
                    if pdo["syncs"] == 0:
                        self.transmit(pdo)

    def transmit(self, pdo):
        pieces = [self.node.get_data(index, sub)[:size].ljust(size, b"\0") for index, sub, size in pdo["objects"]]
        pdo["sent"] = b"".join(pieces)
        self.network.send_message(pdo["id"], pdo["sent"])

    def on_nmt(self, cob_id, data, timestamp):
        if len(data) < 2 or data[1] not in (0, self.id):
            return
        with self.lock:
            if data[0] in (129, 130):
                if data[0] == 129:
                    self.node.data_store.clear()
                    self.state, self.speed, self.controlword = "switch on disabled", 0.0, 0
                self.node.nmt.send_command(0)
                self.node.nmt.send_command(128)
                self.changed = True
            if self.changed:
                self.load_pdos()
            was, self.nmt = self.nmt, self.node.nmt.state
            now = time.monotonic()
            for pdo in self.pdos["transmit"]:
                pdo["due"] = now if pdo["timer"] else None
            if was == "OPERATIONAL" != self.nmt and self.state == "operation enabled":
                self.silence(0x8100)
            self.say(nmt=self.nmt)

    def watch_master(self, now):
        if 0x1016 not in self.node.object_dictionary:
            return
        entry = self.get(0x1016, 1)
        node, limit = entry >> 16 & 0x7F, (entry & 0xFFFF) / 1000
        if not limit:
            self.consumed = None
        elif self.consumed is None or self.consumed[0] != node:
            self.consumed = (node, None)
            self.network.subscribe(0x700 + node, self.on_heartbeat)
        elif self.consumed[1] is not None and now - self.consumed[1] > limit:
            self.consumed = (node, None)
            self.silence(0x8130)

    def on_heartbeat(self, cob_id, data, timestamp):
        with self.lock:
            if self.consumed is not None and cob_id == 0x700 + self.consumed[0] and data[0] != 0:
                self.consumed = (self.consumed[0], time.monotonic())

    # --- the motor

    def step(self, dt):
        target = 0
        if self.state == "operation enabled" and not self.controlword & 0x100:
            target = self.get(0x60FF)
        slope = COAST
        if self.state in ("quick stop active", "fault reaction active"):
            slope = self.get(0x6085)
        elif self.state == "operation enabled":
            slope = self.get(0x6083) if abs(target) > abs(self.speed) else self.get(0x6084)
        self.speed += max(-slope * dt, min(slope * dt, target - self.speed))
        self.turns += self.speed / 60 * dt
        if abs(self.speed) < 1 and self.state == "fault reaction active":
            self.go("fault")
        if abs(self.speed) < 1 and self.state == "quick stop active" and self.get(0x605A) in (1, 2):
            self.go("switch on disabled")

    def run(self):
        last = reported = time.monotonic()
        while True:
            time.sleep(BEAT)
            now = time.monotonic()
            with self.lock:
                if self.changed:
                    self.load_pdos()
                self.step(now - last)
                last = now
                if self.report and now - reported >= self.report:
                    reported = now
                    self.say(turns=self.turns)
                self.watch_master(now)
                if self.nmt != "OPERATIONAL":
                    continue
                for pdo in self.pdos["receive"].values():
                    if pdo["due"] is not None and now > pdo["due"]:
                        pdo["due"] = None
                        self.silence(0x8250)
                for pdo in self.pdos["transmit"]:
                    if pdo["type"] >= 254 and (pdo["sent"] is None or (pdo["due"] is not None and now >= pdo["due"])):
                        self.transmit(pdo)
                        pdo["due"] = max((pdo["due"] or now) + pdo["timer"], now) if pdo["timer"] else None

    def say(self, **what):
        line = {"time": time.monotonic(), "node": self.id, "rpm": round(self.speed), **what}
        print(json.dumps(line), flush=True)


def connect(interface, channel, port):
    network = canopen.Network()
    more = {"host": "127.0.0.1", "port": port, "tcp_tune": True} if interface == "socketcand" else {}
    while True:
        try:
            network.connect(interface=interface, channel=channel, **more)
            return network
        except can.CanError:  # python-can trips over frames that come right behind socketcand's "< ok >"
            time.sleep(0.01)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--interface", default="socketcand")
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--port", type=int, default=29536)
    parser.add_argument("--node", type=int, action="append")
    parser.add_argument("--eds", default=Path(__file__).parents[2] / "data/canopen/drive.eds")
    parser.add_argument("--report", type=float)
    parser.add_argument("--no-blocks", action="store_true", help="python-canopen's own SDO server")
    arguments = parser.parse_args()
    network = connect(arguments.interface, arguments.channel, arguments.port)
    blocks = not arguments.no_blocks
    drives = [Drive(network, node, arguments.eds, arguments.report, blocks) for node in arguments.node or [5]]
    print("ready", flush=True)
    while drives:
        time.sleep(3600)


if __name__ == "__main__":
    main()

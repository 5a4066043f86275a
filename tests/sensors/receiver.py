# SPDX-License-Identifier: Apache-2.0
"""A satellite receiver that speaks NMEA by pynmeagps at the far end of a pty, and gpsd on it."""

import datetime
import os
import pty
import shutil
import socket
import subprocess
import sys
import threading
import tty
from pathlib import Path

import pynmeagps

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "faults"))
from regista_process import wait_for

GPSD = shutil.which("gpsd") or shutil.which("gpsd", path="/usr/sbin:/sbin")


class Receiver:
    """A receiver at the far end of a serial line: ten epochs a second, each GGA, RMC, GSA and GSV."""

    def __init__(self):
        self.far, near = pty.openpty()
        tty.setraw(self.far)
        tty.setraw(near)
        self.path = os.ttyname(near)
        Path(self.path).chmod(0o666)  # gpsd lets go of root
        self.near = near
        self.latitude, self.longitude, self.altitude, self.geoid = 63.41, 10.42, 15.0, 40.5
        self.speed_knots, self.course = 0.0, 0.0
        self.fixed = True
        self.spoil = False
        self.silent = False
        self.done = threading.Event()
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def sentences(self):
        now = datetime.datetime.now(datetime.UTC)
        place = {
            "lat": self.latitude,
            "NS": "N" if self.latitude >= 0 else "S",
            "lon": self.longitude,
            "EW": "E" if self.longitude >= 0 else "W",
        }
        fixed = self.fixed

        def message(kind, **fields):
            return pynmeagps.NMEAMessage("GP", kind, pynmeagps.GET, **fields)

        yield message(
            "RMC",
            time=now.time(),
            status="A" if fixed else "V",
            **place,
            spd=self.speed_knots,
            cog=self.course,
            date=now.date(),
            posMode="A" if fixed else "N",
        )
        yield message(
            "GGA",
            time=now.time(),
            **place,
            quality=1 if fixed else 0,
            numSV=8 if fixed else 0,
            HDOP=0.9,
            alt=self.altitude,
            altUnit="M",
            sep=self.geoid,
            sepUnit="M",
        )
        used = {f"svid_{i:02}": i for i in range(1, 9)} if fixed else {}
        yield message("GSA", opMode="A", navMode=3 if fixed else 1, **used, PDOP=1.6, HDOP=0.9, VDOP=1.3)
        for page in range(2):
            seen = {}
            for slot in range(1, 5):
                number = 4 * page + slot
                seen |= {f"svid_{slot:02}": number, f"elv_{slot:02}": 20 + 8 * number % 60}
                seen |= {f"az_{slot:02}": 45 * number % 360, f"cno_{slot:02}": 40}
            yield message("GSV", numMsg=2, msgNum=page + 1, numSV=8, **seen)

    def run(self):
        while not self.done.wait(0.1):
            if self.silent:
                continue
            lines = [sentence.serialize() for sentence in self.sentences()]
            if self.spoil:  # once in each, and the checksums stay: they are XORs, and two would make up for each other
                lines = [line.replace(b"63", b"73", 1) for line in lines]
            os.write(self.far, b"".join(lines))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.done.set()
        self.thread.join()
        os.close(self.far)
        os.close(self.near)


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Gpsd:
    def __init__(self, port, *receivers):
        self.port = port
        self.process = subprocess.Popen([GPSD, "-N", "-n", "-S", str(port), *receivers], stderr=subprocess.DEVNULL)
        wait_for(self.listens)

    def listens(self):
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def stop(self):
        self.process.kill()
        self.process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()

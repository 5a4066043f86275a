# SPDX-License-Identifier: Apache-2.0
"""The whole way: NMEA of pynmeagps, a serial line (a pty), gpsd, regista-server, TCP, a client of packed bytes."""

import math
import struct
import sys
import time
from pathlib import Path

import pytest
from receiver import GPSD, Gpsd, Receiver, free_port

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "faults"))
from regista_process import ACK, BIN, DATA, NACK, Client, ServerProcess, wait_for

DRIVERS = BIN.parent / "lib/regista"
GPS, LOCALIZE = 13, 25

pytestmark = [
    pytest.mark.skipif(GPSD is None, reason="gpsd is not installed (apt install gpsd)"),
    pytest.mark.skipif(not (DRIVERS / "gps.so").exists(), reason="built without libgps and GeographicLib"),
]


class GpsServer(ServerProcess):
    def __init__(self, folder, gpsd_port, keys):
        driver = f'driver ( name "gps" provides ["gps:0" "localize:0"] port {gpsd_port} {keys} )\n'
        super().__init__(folder, driver, DRIVERS)


STATE = struct.Struct(">2I3i4d4I2d")
LOCAL = ["x", "y", "heading", "xx", "yy", "aa", "xy", "ya", "xa", "weight"]


class Listener:
    """What a client hears of gps:0 and localize:0."""

    def __init__(self, port):
        self.client = Client(port)

    def open(self, interface):
        body = struct.pack(">7I", 0, 0, interface, 0, 1, 0, 0)
        return self.client.ask(1, 0, 3, body)[2]

    def next(self, interface, true=lambda _: True):
        """The next data of the interface for which it is true, unpacked."""
        end = time.monotonic() + 15
        while time.monotonic() < end:
            message = self.client.receive()
            if message[2] != DATA or message[0] != interface:
                continue
            if interface == GPS:
                names = "time_s time_us lat lon alt speed course utm_e utm_n quality sats hdop vdop err_h err_v"
                data = dict(zip(names.split(), STATE.unpack(message[5]), strict=True))
            else:
                assert struct.unpack_from(">IdII", message[5])[2:] == (1, 1)
                numbers = struct.unpack_from(">10d", message[5], 20)
                data = dict(zip(LOCAL, numbers, strict=True))
            if true(data):
                return data
        raise TimeoutError("it did not come")


def to_metres(latitude, longitude, height, origin):
    """East and north, by WGS 84's radii of curvature: good to a millimetre over 100 m."""
    a, e2 = 6378137.0, 0.00669437999014
    phi = math.radians(origin[0])
    w = math.sqrt(1 - e2 * math.sin(phi) ** 2)
    north = math.radians(latitude - origin[0]) * (a * (1 - e2) / w**3 + height)
    return math.radians(longitude - origin[1]) * (a / w + height) * math.cos(phi), north


def test_every_field_arrives_in_its_unit(tmp_path):
    port = free_port()
    with Receiver() as receiver:
        receiver.speed_knots, receiver.course = 3.0, 90.0  # 1.5433 m/s to the east
        with Gpsd(port, receiver.path), GpsServer(tmp_path, port, "datum [63.4095 10.4190 50]") as server:
            listener = Listener(server.port)
            assert listener.open(GPS) == ACK
            data = listener.next(GPS, lambda d: d["quality"] == 1 and d["sats"] == 8 and d["err_h"] > 0)
            assert abs(data["time_s"] + 1e-6 * data["time_us"] - time.time()) < 5
            assert abs(data["lat"] - 634_100_000) <= 2  # NMEA has 1e-5 minutes
            assert abs(data["lon"] - 104_200_000) <= 2
            assert abs(data["alt"] - 55_500) <= 1000  # gpsd takes the geoid of its own model
            assert math.isclose(data["speed"], 3 * 1852 / 3600, abs_tol=0.01)
            assert math.isclose(data["course"], -math.pi / 2, abs_tol=0.01)
            assert math.isclose(data["utm_e"], 570911.67, abs_tol=0.05)  # PROJ, EPSG:32632
            assert math.isclose(data["utm_n"], 7032057.39, abs_tol=0.05)
            assert data["hdop"] > 0
            assert data["vdop"] > 0

            assert listener.open(LOCALIZE) == ACK
            local = listener.next(LOCALIZE)
            x, y = to_metres(63.41, 10.42, 50, (63.4095, 10.4190))
            assert math.isclose(local["x"], x, abs_tol=0.03)
            assert math.isclose(local["y"], y, abs_tol=0.03)
            assert 0.1 < math.sqrt(local["xx"]) < 20
            assert local["weight"] == 1

            # A step of the receiver, and how long it takes to be heard.
            receiver.latitude += 9e-5
            moved = listener.next(LOCALIZE, lambda d: d["y"] > y + 5)
            assert math.isclose(moved["y"] - y, to_metres(63.41009, 10.42, 50, (63.41, 10.42))[1], abs_tol=0.03)
            assert math.isclose(moved["x"], x, abs_tol=0.03)


def test_southern_and_western_halves_have_their_signs(tmp_path):
    port = free_port()
    with Receiver() as receiver:
        receiver.latitude, receiver.longitude = -22.95, -43.21
        with Gpsd(port, receiver.path), GpsServer(tmp_path, port, "datum [-22.951 -43.211]") as server:
            listener = Listener(server.port)
            assert listener.open(GPS) == ACK
            data = listener.next(GPS, lambda d: d["quality"] == 1)
            assert abs(data["lat"] + 229_500_000) <= 2
            assert abs(data["lon"] + 432_100_000) <= 2


def test_no_fix_and_corrupted_lines_are_no_position(tmp_path):
    port = free_port()
    with Receiver() as receiver:
        receiver.fixed = False
        keys = "datum [63.4095 10.4190 50] timeout 3"
        with Gpsd(port, receiver.path), GpsServer(tmp_path, port, keys) as server:
            listener = Listener(server.port)
            assert listener.open(GPS) == ACK
            assert listener.open(LOCALIZE) == ACK
            listener.next(GPS, lambda d: d["quality"] == 0)
            wait_for(lambda: "no fix for " in server.log())
            assert "is the sky free?" in server.log()
            receiver.fixed = True
            listener.next(LOCALIZE)
            wait_for(lambda: "a fix again after " in server.log())
            receiver.spoil = True  # 10° farther north, if somebody believed it
            listener.next(GPS, lambda d: d["quality"] == 0)
            receiver.spoil = False
            assert abs(listener.next(LOCALIZE)["y"]) < 100
            assert "refused" not in server.log()


def test_a_silent_receiver_is_told_and_comes_back(tmp_path):
    port = free_port()
    with Receiver() as receiver:
        keys = "datum [63.4095 10.4190 50] timeout 1"
        with Gpsd(port, receiver.path), GpsServer(tmp_path, port, keys) as server:
            listener = Listener(server.port)
            assert listener.open(GPS) == ACK
            listener.next(GPS, lambda d: d["quality"] == 1)
            receiver.silent = True
            listener.next(GPS, lambda d: d["quality"] == 0)
            wait_for(lambda: "the receiver is silent" in server.log())
            receiver.silent = False
            listener.next(GPS, lambda d: d["quality"] == 1)


def test_gpsd_is_restarted(tmp_path):
    port = free_port()
    with Receiver() as receiver:
        gpsd = Gpsd(port, receiver.path)
        try:
            with GpsServer(tmp_path, port, "datum_rest 1 datum_satellites 4") as server:
                listener = Listener(server.port)
                assert listener.open(GPS) == ACK
                assert listener.open(LOCALIZE) == ACK
                listener.next(LOCALIZE)
                wait_for(lambda: "write `datum [63.41" in server.log())
                gpsd.stop()
                wait_for(lambda: f"gpsd at 127.0.0.1:{port} ended" in server.log())
                receiver.latitude += 9e-5
                gpsd = Gpsd(port, receiver.path)
                # The origin that was found before is kept.
                assert math.isclose(listener.next(LOCALIZE, lambda d: d["y"] > 5)["y"], 10, abs_tol=0.5)
        finally:
            gpsd.stop()


def test_a_missing_gpsd_is_refused_in_words(tmp_path):
    port = free_port()
    with GpsServer(tmp_path, port, "") as server:
        assert Listener(server.port).open(GPS) == NACK
        wait_for(lambda: f"gpsd at 127.0.0.1:{port}" in server.log() and "is it running?" in server.log())


def test_gpsd_without_a_receiver(tmp_path):
    port = free_port()
    # Without receivers gpsd wants a socket by which it might be told of one.
    with Gpsd(port, "-F", str(tmp_path / "control")), GpsServer(tmp_path, port, "timeout 1") as server:
        listener = Listener(server.port)
        assert listener.open(GPS) == ACK
        wait_for(lambda: "has no receiver: is it plugged in?" in server.log())

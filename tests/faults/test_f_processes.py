# SPDX-License-Identifier: Apache-2.0
"""Faults of whole processes. Stop times come from the driver's own record, on the clock that Python calls monotonic."""

import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from regista_process import ACK, NOISE, PLUGINS, POSITION2D, SERVER, Client, Server, closing, quantiles, wait_for

FOLDER = str(Path(__file__).parent)

CLIENT = """
import sys, time
sys.path.insert(0, {folder!r})
from regista_process import Client
client = Client({port})
client.identify("teleop@host")
client.open()
client.pull()
while True:
    client.velocity(0.5)
    time.sleep(0.05)
"""


def commander(port):
    """A process that drives position2d:0."""
    return subprocess.Popen([sys.executable, "-c", CLIENT.format(folder=FOLDER, port=port)])


def serve(*arguments, timeout=20, **options):
    """A server that is expected to end by itself."""
    return subprocess.run([SERVER, *arguments], capture_output=True, text=True, timeout=timeout, check=False, **options)


def test_f01_commanding_client_is_killed(tmp_path):
    with Server(tmp_path) as server, closing([Client(server.port)]) as (watcher,):
        watcher.open()
        stops = []
        for _ in range(8):
            begin = time.monotonic()
            process = commander(server.port)
            server.driven(0.5, since=begin)
            killed = time.monotonic()
            process.kill()
            process.wait()
            stops.append(server.rested(killed) - killed)
        p50, p99 = quantiles("f01_stop", stops)
        assert p50 < 0.020 + NOISE and p99 < 0.020 + 2 * NOISE
        wait_for(lambda: 'position2d:0 stopped: owner "teleop@host" disconnected' in server.log())


def test_f02_cable_pulled(tmp_path):
    """In a network namespace whose loopback goes down: both sides stay silent, as behind a pulled cable."""
    inner = f"""
import fcntl, socket, struct, sys, time, pathlib
sys.path.insert(0, {FOLDER!r})
from regista_process import *
def loopback(up):
    with socket.socket() as s:
        fcntl.ioctl(s, 0x8914, struct.pack("16sH22x", b"lo", 0x49 if up else 0x48))  # SIOCSIFFLAGS
loopback(True)
with Server(pathlib.Path({str(tmp_path)!r})) as server:
    client = Client(server.port)
    client.open()
    client.velocity(0.5)
    driven = server.driven(0.5)
    loopback(False)
    print("stop", server.rested(driven + 1e-6) - driven)
    cut = time.monotonic()
    wait_for(lambda: "client 1 closed" in server.log(), 20)
    print("closed", time.monotonic() - cut)
    print(server.log())
"""
    printed = in_namespace(inner)
    stop = float(re.search(r"stop (\S+)", printed)[1])
    closed = float(re.search(r"closed (\S+)", printed)[1])
    print(f"f02_stop: {1e3 * stop:.1f} ms; connection closed {closed:.1f} s after")
    assert 0.4 <= stop < 0.5 + 0.01 + 0.02 + NOISE
    assert closed < 8
    assert re.search(r"position2d:0 stopped: no command for \d+ ms \(lease 500 ms\)", printed)


def test_connections_come_too_fast(tmp_path):
    """20 a second from an address that is not loopback: in a network namespace, whose `lo` has another address, too."""
    inner = f"""
import fcntl, json, socket, struct, sys, time, pathlib
sys.path.insert(0, {FOLDER!r})
from regista_process import *
OTHER = "10.7.0.1"
def set_up(request, name, value):
    with socket.socket() as s:
        fcntl.ioctl(s, request, struct.pack("16s16s", name, value))
set_up(0x8914, b"lo", struct.pack("h", 0x49))  # SIOCSIFFLAGS: up, running
set_up(0x8916, b"lo:1", struct.pack("hH4s", socket.AF_INET, 0, socket.inet_aton(OTHER)))  # SIOCSIFADDR
with Server(pathlib.Path({str(tmp_path)!r}), options=["--listen", OTHER]) as server:
    sockets, banners = [], []
    begin = time.monotonic()
    for _ in range(100):
        sockets.append(socket.create_connection((OTHER, server.port), 10))
        banners.append(sockets[-1].recv(32))
    allowed = 20 * (1 + time.monotonic() - begin)
    refused = sum(banner.startswith(b"Player v. refused: too often") for banner in banners)
    assert 20 <= 100 - refused <= allowed + 1, (refused, allowed)
    assert all(b"refused" not in banner for banner in banners[:20])
    clients = [Client(server.port) for _ in range(100)]  # over loopback
    assert all(b"refused" not in client.banner for client in clients)
    status = clients[0].ask(1, 0, 106)[5]
    assert json.loads(status[8:].split(b"\\0")[0])["connections_refused"] == refused, status[:200]
    time.sleep(0.1)  # after which one more is allowed
    assert b"refused" not in socket.create_connection((OTHER, server.port), 10).recv(32)
    lines = [line for line in server.log().splitlines() if "more than 20 connections a second" in line]
    assert len(lines) == 1, "one in five seconds"
    assert f"client {{OTHER}} refused: more than 20 connections a second" in lines[0]
"""
    in_namespace(inner)


def in_namespace(program):
    """Run it where the network is nobody else's; what it printed."""
    command = ["unshare", "--map-root-user", "--net", sys.executable, "-c", program]
    if subprocess.run([*command[:3], "true"], check=False, capture_output=True).returncode != 0:
        pytest.skip("no network namespaces here")
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


def test_f03_commanding_client_hangs(tmp_path):
    with Server(tmp_path) as server:
        process = commander(server.port)
        try:
            server.driven(0.5)
            process.send_signal(signal.SIGSTOP)
            stopped = time.monotonic()
            stop = server.rested(stopped) - stopped
        finally:
            process.kill()
            process.wait()
        print(f"f03_stop: {1e3 * stop:.1f} ms")
        assert 0.4 < stop < 0.5 + 0.01 + 0.02 + NOISE
        wait_for(lambda: re.search(r"stopped: no command for \d+ ms \(lease 500 ms\)", server.log()))


def test_f05_request_flood_without_reading_costs_no_memory(tmp_path):
    with Server(tmp_path) as server, closing([Client(server.port)]) as (other,):
        other.ask(1, 0, 1)
        before = server.rss()
        flood = Client(server.port)
        flood.socket.settimeout(0.2)
        most = 0
        try:
            for _ in range(2000):
                for _ in range(200):
                    flood.send(1, 0, 3, 1)
                most = max(most, server.rss() - before)
        except OSError:
            pass
        # A flood that stood still is closed by the server, too: after 5 s.
        wait_for(lambda: "closed: slow consumer" in server.log())
        flood.close()
        print(f"f05: RSS grew by {most / 1024:.0f} KiB")
        assert most <= 4 << 20 or "asan" in str(SERVER) or "tsan" in str(SERVER)
        assert other.ask(1, 0, 1)[2] == ACK


def test_f10_driver_that_hangs_on_ends_the_server_with_70(tmp_path):
    with Server(tmp_path, 'fault "hang" at "command" seconds 60', more="server ( hang_exit 0.5 )") as server:
        client = Client(server.port)
        client.open()
        begin = time.monotonic()
        client.velocity(0.5)
        assert server.process.wait(10) == 70
        assert 0.5 <= time.monotonic() - begin < 0.5 + 0.25 + 4 * NOISE
        log = server.log()
        assert re.search(r'driver "fake_base" did not return for \d+ ms', log)
        assert "a driver has hung for too long: exiting, so that the service is started again" in log
        client.close()


def test_f11_driver_segfaults(tmp_path):
    """The server dies with it. That the hardware then stops is the drive's own doing, which nothing here can show."""
    with Server(tmp_path, 'fault "segfault" at "command"', preexec_fn=no_core) as server:
        client = Client(server.port)
        client.open()
        client.velocity(0.5)
        assert server.process.wait(10) != 0
        client.close()


def no_core():
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


@pytest.mark.parametrize(
    ("plugin", "text"),
    [
        ("no_symbol", r": undefined symbol regista_plugin \(it is no regista driver"),
        ("undefined_symbol", r": undefined symbol foo \(built for ABI 1, server has 1\)"),
        ("wrong_api", r": built for ABI 2, server has 1"),
        ("wrong_layout", r": built with another compiler or another regista of ABI 1"),
        ("nowhere", r": cannot open shared object file: No such file or directory"),
    ],
)
@pytest.mark.parametrize("check", [False, True])
def test_f12_plugin_broken(tmp_path, plugin, text, check):
    file = PLUGINS / f"{plugin}.so"
    config = tmp_path / "robot.cfg"
    config.write_text(f'driver ( name "x" plugin "{file}" provides ["position2d:0"] )')
    done = serve("--port", "0", *(["--check"] if check else []), config)
    assert done.returncode == 78
    assert done.stdout == ""
    assert re.search(re.escape(f'plugin "{file}"') + text, done.stderr), done.stderr


def test_f12_check_moves_nothing(tmp_path):
    record = tmp_path / "record"
    config = tmp_path / "robot.cfg"
    config.write_text(f'driver ( name "fake_base" provides ["position2d:0"] alwayson yes log "{record}" )')
    done = serve("--check", "--plugins", PLUGINS, config)
    assert done.returncode == 0, done.stderr
    assert record.read_text() == ""


SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <time.h>
/* The wall clock jumps by an hour: back and forth every 100 ms of the monotonic clock, or once a second after start. */
int clock_gettime(clockid_t clock, struct timespec* time) {
  static int (*real)(clockid_t, struct timespec*);
  if (!real) real = (int (*)(clockid_t, struct timespec*))dlsym(RTLD_NEXT, "clock_gettime");
  int result = real(clock, time);
  if (clock == CLOCK_REALTIME) {
    struct timespec steady;
    real(CLOCK_MONOTONIC, &steady);
#ifdef ONCE
    static long start;
    if (!start) start = steady.tv_sec;
    time->tv_sec += steady.tv_sec > start + 1 ? 3600 : 0;
#else
    time->tv_sec += steady.tv_nsec / 100000000 % 2 ? 3600 : -3600;
#endif
  }
  return result;
}
"""


def jumping_clock(folder, *flags):
    source = folder / "shim.c"
    source.write_text(SHIM)
    shim = folder / "shim.so"
    subprocess.run(["cc", "-shared", "-fPIC", *flags, "-o", shim, source, "-ldl"], check=True)
    return {**os.environ, "LD_PRELOAD": str(shim)}


@pytest.mark.skipif("san" in str(SERVER), reason="a sanitizer wants to be loaded first")
def test_f19_wall_clock_jumps_once(tmp_path):
    with Server(tmp_path, env=jumping_clock(tmp_path, "-DONCE"), options=["--json-log"]) as server:
        client = Client(server.port)
        assert client.ask(1, 0, 100)[2] == ACK  # the extension: events
        while b"wall clock" not in (event := client.receive())[5]:
            pass
        text = b"ms ahead; leases, time-outs and the stamps of data follow the monotonic clock"
        assert text in event[5]
        lines = wait_for(lambda: [json.loads(line) for line in server.log().splitlines() if "jumped" in line])
        assert len(lines) == 1
        assert abs(int(re.search(r"jumped (\d+) ms ahead", lines[0]["message"])[1]) - 3600_000) < 100
        assert abs(lines[0]["monotonic_s"] - time.monotonic()) < 5
        client.close()


@pytest.mark.skipif("san" in str(SERVER), reason="a sanitizer wants to be loaded first")
def test_f19_wall_clock_jumps(tmp_path):
    with Server(tmp_path, env=jumping_clock(tmp_path)) as server:
        client = Client(server.port)
        client.open()
        last = None
        for _ in range(100):
            message = client.receive()
            if last is not None:
                assert 0 < message[4] - last < 5, "stamps of data follow the steady clock"
            last = message[4]
        client.velocity(0.5)
        driven = server.driven(0.5)
        stop = server.rested(driven + 1e-6) - driven
        print(f"f19_stop: {1e3 * stop:.1f} ms")
        assert 0.4 <= stop < 0.5 + 0.01 + NOISE
        told = [line for line in server.log().splitlines() if "the wall clock jumped" in line]
        assert len(told) == 1, "one in five seconds"
        assert re.match(r"\[\d{4}-.*\] \[warning\] \[\d+\.\d{6}\] the wall clock jumped 7[12]\d{5} ms ", told[0])
        client.close()


def test_f20_sigterm_mid_command(tmp_path):
    with Server(tmp_path) as server:
        client = Client(server.port)
        assert client.ask(1, 0, 100)[2] == ACK  # the extension: events
        client.open()
        client.velocity(0.5)
        server.driven(0.5)
        asked = time.monotonic()
        server.process.terminate()
        assert server.process.wait(10) == 0
        ended = time.monotonic() - asked
        stop = server.rested(asked) - asked
        print(f"f20: zero after {1e3 * stop:.1f} ms, end after {1e3 * ended:.1f} ms")
        assert stop < 0.2 + NOISE
        assert ended < 2
        assert "server shutting down" in server.log()
        assert [e[1] for e in server.events("halt", "close")][-2:] == ["halt", "close"]
        told = b""
        while more := client.socket.recv(65536):
            told += more
        assert b"server shutting down" in told
        client.close()


def test_f20_second_sigterm_ends_at_once(tmp_path):
    with Server(tmp_path, 'fault "hang" at "command" seconds 30') as server:
        client = Client(server.port)
        client.open()
        client.velocity(0.5)
        server.driven(0.5)
        server.process.terminate()
        wait_for(lambda: "server shutting down" in server.log())
        asked = time.monotonic()
        server.process.terminate()
        assert server.process.wait(10) != 0
        assert time.monotonic() - asked < 1
        client.close()


def test_f24_port_in_use(tmp_path):
    with Server(tmp_path) as server:
        record = tmp_path / "second"
        config = tmp_path / "second.cfg"
        config.write_text(f'driver ( name "fake_base" provides ["position2d:0"] alwayson yes log "{record}" )')
        begin = time.monotonic()
        done = serve("--port", str(server.port), "--plugins", PLUGINS, config)
        assert time.monotonic() - begin < 1 + NOISE
        assert done.returncode == 71
        assert done.stderr == (
            f"cannot listen on 127.0.0.1:{server.port}: Address already in use "
            f"(is another server running? pid {server.process.pid})\n"
        )
        assert record.read_text() == "", "no driver was started"


def test_f25_out_of_descriptors(tmp_path):
    with Server(tmp_path, arguments=["prlimit", "--nofile=32"]) as server:
        first = Client(server.port)
        first.open()
        flood = []
        for _ in range(60):  # the kernel accepts for the server
            flood.append(socket.create_connection(("127.0.0.1", server.port)))
        first.pull()
        cpu, begin = server.cpu(), time.monotonic()
        time.sleep(1.5)  # over which the processor's use is measured
        use = (server.cpu() - cpu) / (time.monotonic() - begin)
        print(f"f25: {100 * use:.1f} % of a processor while out of descriptors")
        assert use < 0.05 or "san" in str(SERVER)
        assert first.ask(POSITION2D, 0, 1)[2] == ACK, "those who are in are served"
        for one in flood:
            one.close()
        late = Client(server.port)
        assert late.ask(1, 0, 1)[2] == ACK
        late.close()
        first.close()


def test_f26_within_little_memory(tmp_path):
    """512 MiB of address space, and clients that waste what they can."""
    if "san" in str(SERVER):
        pytest.skip("sanitizers need terabytes of address space")
    with Server(tmp_path, arguments=["prlimit", f"--as={512 << 20}"]) as server:
        wasters = [Client(server.port) for _ in range(100)]
        with closing(wasters):
            for waster in wasters:
                waster.pull()
                waster.open()
            for _ in range(20):
                for waster in wasters[:20]:
                    try:
                        for _ in range(50):
                            waster.send(1, 0, 3, 1)
                    except OSError:
                        pass
            other = Client(server.port)
            assert other.ask(1, 0, 1)[2] == ACK
            other.close()
        assert server.process.poll() is None


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (
            'driver ( name "fake_base" provides ["position2d:0"] rtae 50 )',
            r":1:53: unknown key 'rtae'; did you mean 'rate'\?",
        ),
        ('drivr ( name "fake_base" )', r":1:1: .*did you mean 'driver'\?"),
        ('driver ( name "fake_base" provides ["position2d:0"] lease "long" )', r":1:59: 'lease' must be a number"),
        (
            'driver ( name "fake_base" provides ["position2d:0"] lease 30 )',
            r":1:59: 'lease' is 30, must be within \[0.1, 2\] s",
        ),
        ('unit_length "feet" driver ( name "fake_base" )', r":1:13: 'unit_length' must"),
        ('driver ( name "fake_base" provides ["positon2d:0"] )', r":1:37: .*did you mean 'position2d'\?"),
    ],
)
def test_f32_configuration_is_wrong(tmp_path, text, error):
    config = tmp_path / "robot.cfg"
    config.write_text(text)
    done = serve("--port", "0", "--plugins", PLUGINS, config)
    assert done.returncode == 78
    assert done.stdout == ""
    assert re.search(re.escape(str(config)) + error, done.stderr), done.stderr


def test_f34_starved_of_the_processor(tmp_path):
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        with Server(tmp_path) as server:
            client = Client(server.port)
            client.open()
            client.pull()
            stops = []
            for i in range(3):
                client.velocity(0.5 + i)
                driven = server.driven(0.5 + i)
                stops.append(server.rested(driven + 1e-6) - driven)
            quantiles("f34_stop", stops)
            assert min(stops) >= 0.4
            assert max(stops) < 0.5 + 2 * 0.01 + 2 * NOISE
            status = client.ask(1, 0, 106)[5]
            missed = json.loads(status[8:].split(b"\0")[0])["drivers"][0]["beats_missed"]
            print(f"f34: {missed} beats missed")
            if missed > 0:
                wait_for(lambda: re.search(r'driver "fake_base": deadline missed: \d+ ms', server.log()))
            client.close()
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def test_l4_overload(tmp_path):
    """A short form, 20 x 100 Hz: subscribers that read nothing, and one client that drives on."""
    with Server(tmp_path, "echo yes samples 5") as server:
        idle = [Client(server.port) for _ in range(20)]
        with closing(idle):
            for client in idle:
                client.open()
            commander_ = Client(server.port)
            commander_.open()
            commander_.pull()
            trips = []
            for i in range(100):
                asked = time.monotonic()
                commander_.velocity(i / 128)
                assert commander_.ask(POSITION2D, 0, 1)[2] == ACK
                trips.append(time.monotonic() - asked)
                time.sleep(0.01)
            p50, p99 = quantiles("l4_round_trip", trips)
            assert p50 < 0.02 and p99 < 0.02 + NOISE
            commander_.close()
        assert server.process.poll() is None


def test_l5_idle_connections(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 600:
        pytest.skip("too few descriptors are allowed here")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 4096)), hard))
    with Server(tmp_path) as server:
        Client(server.port).close()
        before = server.rss()
        idle, accepts = [], []
        with closing(idle):
            for _ in range(500):
                asked = time.monotonic()
                idle.append(Client(server.port))
                accepts.append(time.monotonic() - asked)
            for client in idle:
                assert client.ask(1, 0, 1)[2] == ACK
            each = (server.rss() - before) / 500
            print(f"l5: {each / 1024:.1f} KiB for each of 500")
            p50, p99 = quantiles("l5_accept", accepts)
            assert each <= 64 << 10 or "san" in str(SERVER)
            assert p50 < 0.05 and p99 < 0.05 + NOISE


def test_l6_churn(tmp_path):
    with Server(tmp_path) as server:

        def churn(count):
            for _ in range(count):
                client = Client(server.port)
                client.open()
                client.close()

        def settled():
            return wait_for(lambda: len(server.events("open")) == len(server.events("close")) and server.descriptors())

        churn(100)
        descriptors, memory = settled(), server.rss()
        churn(500)
        assert settled() == descriptors
        growth = server.rss() - memory
        print(f"l6: RSS grew by {growth / 1024:.0f} KiB over 500 connections")
        assert growth <= max(0.02 * memory, 512 << 10) or "san" in str(SERVER)

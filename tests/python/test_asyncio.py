# SPDX-License-Identifier: Apache-2.0
"""Robots in an event loop, beside a real server."""

import asyncio
import time

import pytest
import regista
import regista.asyncio
from regista import position1d, position2d
from scripted import obliging


def run(work, timeout=20):
    async def limited():
        return await asyncio.wait_for(work(), timeout)

    return asyncio.run(limited())


def test_drives_while_others_run(port):
    async def work():
        ticks = 0

        async def tick():
            nonlocal ticks
            while True:
                ticks += 1
                await asyncio.sleep(0.005)

        ticking = asyncio.create_task(tick())
        async with regista.asyncio.Robot("127.0.0.1", port) as robot:
            base = await robot.position2d()
            assert base is await robot.position2d()
            await base.reset_odometry()
            count = 0
            async for state in base:
                assert isinstance(state, position2d.State)
                count += 1
                if state.pose.x >= 0.2:
                    break
                base.set_velocity(x=0.5)
            await base.stop()
            assert count > 20
            assert (await base.geometry()).size.length == pytest.approx(0.18)
        ticking.cancel()
        assert ticks > 20

    run(work)


def test_several_requests_at_once_each_get_their_own_answer(port):
    async def work():
        async with regista.asyncio.Robot("127.0.0.1", port) as robot:
            base, kicker, table = await asyncio.gather(robot.position2d(), robot.kicker(), robot.device("position1d:0"))
            geometry, noise, status, devices, table_geometry, limits = await asyncio.gather(
                base.geometry(),
                base.property("noise"),
                robot.status(),
                robot.devices(),
                table.request(position1d.GetGeometry()),
                kicker.request(regista.kicker.GetLimits()),
            )
            assert geometry.size.length == pytest.approx(0.18)
            assert noise == 0.01
            assert "clients" in status
            assert [d.driver for d in devices][:2] == ["simulated_base", "simulated_battery"]
            assert table_geometry.size.width == pytest.approx(0.3)
            assert limits.kick_speed_mps == pytest.approx(6.5)
            await base.set_property("noise", 0.01)
            with pytest.raises(regista.RefusedError, match="of another type"):
                await base.set_property("noise", 1)
            with pytest.raises(regista.RefusedError, match="gps:0"):
                await robot.gps()

    run(work)


def test_destinations_and_time_outs(port):
    async def work():
        async with regista.asyncio.Robot("127.0.0.1", port, name="async@python") as robot:
            base = await robot.position2d()
            await base.reset_odometry()
            await base.follow([(0.2, 0), (0.2, 0.2, 0)], timeout=10)
            assert base.proxy.is_at(0.2, 0.2)
            assert (await base.motion()).owner in ("", "async@python")
            with pytest.raises(regista.TimeoutError, match=r"drive: not there after 0.2 s"):
                await base.drive_to(1000, 0, timeout=0.2)
            await base.take()
            await base.release()

    run(work)


def test_data_for_whoever_asks(port):
    async def work():
        async with regista.asyncio.Robot("127.0.0.1", port) as robot:
            assert not await robot.read(timeout=0.1)
            base, kicker = await robot.position2d(), await robot.kicker()
            robot.record()

            async def some(device):
                return [state async for state in _first(device, 5)]

            states, kicks = await asyncio.gather(some(base), some(kicker))
            assert len(states) == len(kicks) == 5
            assert len(robot.messages()) >= 8
            assert base.latest(position2d.State).count > 0
            kicker.proxy.charge(True)
            async for state in kicker:
                if state.charged:
                    break

    async def _first(device, count):
        async for state in device:
            yield state
            count -= 1
            if count == 0:
                return

    run(work)


def test_a_killed_server_ends_every_wait(start):
    async def work():
        server = start()
        async with regista.asyncio.Robot("127.0.0.1", server.port, timeout=1) as robot:
            base = await robot.position2d()

            async def watch():
                async for _ in base:
                    pass

            watching = asyncio.create_task(watch())
            await robot.read(timeout=2)
            server.process.kill()
            begin = time.monotonic()
            with pytest.raises(regista.ConnectionError):
                await watching
            assert time.monotonic() - begin < 3
            with pytest.raises(regista.ConnectionError):
                await base.geometry()
            with pytest.raises(regista.ConnectionError):
                await robot.read(timeout=1)

    run(work)


def test_a_request_without_an_answer_times_out_and_a_cancelled_one_does_no_harm(scripted):
    def deaf(peer):
        while True:
            message = peer.next()
            if message.interface == 1:
                peer.serve(message)

    async def work():
        server = scripted(deaf)
        async with regista.asyncio.Robot("127.0.0.1", server.port, timeout=0.3) as robot:
            base = await robot.position2d()
            with pytest.raises(regista.TimeoutError, match="GET_GEOM: 300 ms: no answer"):
                await base.geometry()
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(base.geometry(), 0.05)
            with pytest.raises(regista.TimeoutError, match="GET_GEOM"):
                await base.geometry()

    run(work)


def test_nobody_answers(scripted):
    async def work():
        with pytest.raises(regista.ConnectionError):
            async with regista.asyncio.Robot("127.0.0.1", 1):
                pass

    run(work)


def test_an_idle_connection_stays(scripted):
    """Probes for a sign of life are sent from the loop's timer."""

    async def work():
        server = scripted(obliging)
        async with regista.asyncio.Robot("127.0.0.1", server.port, timeout=0.2) as robot:
            await asyncio.sleep(0.8)
            assert robot.connected
            await robot.position2d()

    run(work)

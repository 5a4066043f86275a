# SPDX-License-Identifier: Apache-2.0
import asyncio

import regista.asyncio


# In asyncio's event loop, beside whatever else runs there.
async def main() -> None:
    async with regista.asyncio.Robot("localhost") as robot:
        base = await robot.position2d()
        await base.reset_odometry()
        async for state in base:  # each state that comes
            if state.pose.x >= 0.5:
                break
            base.set_velocity(x=0.5)
        await base.stop()
        print(f"drove {base.state.pose.x:.1f} m")


asyncio.run(main())

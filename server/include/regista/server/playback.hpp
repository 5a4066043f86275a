// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/device/plugin.hpp>

namespace regista {

/// The driver `playback`: offers whatever devices its `provides` names and publishes, as it comes, what is fed to it in
/// Player's wire format, header and body. `regista replay` is such a feeder; a recording looks like the robot it was
/// taken from.
///
///     driver ( name "playback" provides ["position2d:0" "power:0"] input "frames.fifo" alwayson yes )
///
/// Data frames are published at once. An ACK is the answer that later requests of its device and subtype get. Commands
/// are refused: nothing moves. `input` is a FIFO or a file, by default standard input; when it ends, the driver fails
/// and tries to open it again.
///
/// It is here and not among the drivers because it reads bytes, as the devices of other servers do.
extern const Plugin playback;

}  // namespace regista

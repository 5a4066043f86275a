// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace regista {

/// Tell systemd, or whoever set NOTIFY_SOCKET, how the service is: sd_notify(3), of whose library this is all we need.
void notify_service_manager(std::string_view state);

}  // namespace regista

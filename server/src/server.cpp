// SPDX-License-Identifier: Apache-2.0
#include <regista/server/server.hpp>

#include "impl.hpp"

namespace regista {

Server::Server(const ConfigFile& config, ServerOptions options)
    : impl_{std::make_unique<Impl>(config, std::move(options))} {}
Server::~Server() = default;

bool Server::run() { return impl_->run(); }
void Server::stop() { impl_->stop(); }
std::uint16_t Server::port() const { return impl_->port(); }
std::vector<std::string> Server::endpoints() const { return impl_->endpoints(); }
void Server::on_ready(std::function<void()> ready) { impl_->on_ready = std::move(ready); }
void Server::on_hang(std::function<void()> hang) { impl_->on_hang = std::move(hang); }

}  // namespace regista

// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <regista/server/playback.hpp>
#include <regista/xdr/framer.hpp>
#include <regista/xdr/registry.hpp>

namespace regista {

namespace {

// What one beat takes in; the rest waits for the next, so that a file does not keep the driver from its messages.
constexpr std::size_t most_bytes_a_beat = 1 << 20;

class Playback final : public Driver {
 public:
  explicit Playback(Setup& setup) : input_{setup.config.has("input") ? setup.config.file("input") : "/dev/stdin"} {
    for (const PlacedName& offered : setup.config.device_names("provides")) add(setup, offered.name);
  }
  ~Playback() override { shut(); }

  Result<> open() override {
    descriptor_ = ::open(input_.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (descriptor_ < 0) return failure(errno, "open");
    framer_ = xdr::Framer{};
    return {};
  }

  Result<> read(const Tick& /*tick*/) override {
    for (std::size_t taken = 0; taken < most_bytes_a_beat;) {
      const auto space = framer_.space();
      const ssize_t size = ::read(descriptor_, space.data(), space.size());
      if (size < 0 && errno == EINTR) continue;
      if (size < 0 && errno == EAGAIN) return {};
      if (size < 0) return failure(errno, "read");
      if (size == 0) return Error{std::errc::no_message_available, "the recording has ended (" + input_.string() + ")"};
      framer_.commit(static_cast<std::size_t>(size));
      taken += static_cast<std::size_t>(size);
      if (Result<> shown = show_frames(); !shown) return shown;
    }
    return {};
  }

  void publish() override {}  // data go up when they come
  void halt() noexcept override {}
  void close() noexcept override { shut(); }
  [[nodiscard]] std::span<const int> descriptors() const override { return {&descriptor_, 1}; }

 private:
  struct Device {
    PortCore* port;
    std::vector<std::pair<std::uint8_t, AnyReply>> answers;  ///< by subtype of the request
  };

  void add(Setup& setup, const DeviceName& name) {
    PortCore& port = setup.ports.emplace_back();
    port.number = setup.ports.size() - 1;
    port.interface = name.interface;
    port.key = name.key;
    Device& device = devices_.emplace_back(Device{.port = &port, .answers = {}});
    for_each_message(AnyRequest::Messages{},
                     [&]<typename M>(std::size_t alternative) { answer_request<M>(device, alternative); });
  }

  template <RequestType M>
  static void answer_request(Device& device, std::size_t alternative) {
    if constexpr (field_count<typename M::Reply> > 0) {
      if (M::message.interface != device.port->interface) return;
      device.port->requests[alternative] = [&device](const AnyRequest&, const ReplyTo& to) {
        const auto known = std::ranges::find(device.answers, M::message.subtype, [](const auto& a) { return a.first; });
        Reply reply{.to = to, .port = device.port->number};
        if (known != device.answers.end()) {
          reply.answer = known->second;
        } else {
          reply.answer =
              Error{std::errc::not_supported, "the recording holds no answer to " + std::string{M::message.name}};
        }
        device.port->reply(std::move(reply));
      };
    }
  }

  Result<> show_frames() {
    while (true) {
      const Result<std::optional<xdr::Frame>> frame = framer_.next();
      if (!frame) return frame.error();
      if (!*frame) return {};
      if (Result<> shown = show(**frame); !shown) return shown;
    }
  }

  Result<> show(const xdr::Frame& frame) {
    const player::DeviceAddress& address = frame.header.address;
    const auto device = std::ranges::find_if(devices_, [&](const Device& d) {
      return d.port->offered && d.port->interface == address.interface && d.port->index == address.index;
    });
    if (device == devices_.end()) {
      return Error{std::errc::invalid_argument, "the recording has device " + std::to_string(address.interface) + ':' +
                                                    std::to_string(address.index) + ", which `provides` does not name"};
    }
    if (frame.header.kind == Kind::ack) return keep_answer(*device, frame);
    if (Result<> decoded = xdr::decode_any(frame.header, frame.body, data_); !decoded) return decoded;
    std::visit([&](const auto& data) { device->port->send(data, device->port->now); }, data_);
    return {};
  }

  static Result<> keep_answer(Device& device, const xdr::Frame& frame) {
    Result<> decoded;
    const bool known = xdr::with_body_type(frame.header, [&]<typename Body>() {
      if constexpr (std::is_constructible_v<AnyReply, std::in_place_type_t<Body>>) {
        Body body;
        decoded = xdr::decode(frame.body, body);
        if (!decoded) return;
        std::erase_if(device.answers, [&](const auto& a) { return a.first == frame.header.subtype; });
        device.answers.emplace_back(frame.header.subtype, std::move(body));
      }
    });
    return known ? decoded : Result<>{xdr::unknown_message(frame.header)};
  }

  [[nodiscard]] Error failure(int error, const std::string& what) const {
    return {std::error_code{error, std::generic_category()}, what + ' ' + input_.string()};
  }

  void shut() {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }

  std::filesystem::path input_;
  std::deque<Device> devices_;  ///< handlers refer to their elements
  int descriptor_ = -1;
  xdr::Framer framer_;
  AnyData data_;
};

}  // namespace

const Plugin playback{
    .name = "playback",
    .summary = "Publishes a recording that is fed to it",
    .rate_hz = 0,
    .stops_by_itself = true,
    .create = [](Setup& setup) -> std::unique_ptr<Driver> { return std::make_unique<Playback>(setup); }};

}  // namespace regista

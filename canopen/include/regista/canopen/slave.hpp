// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <regista/canopen/can_bus.hpp>
#include <regista/canopen/emcy.hpp>
#include <regista/canopen/lss.hpp>
#include <regista/canopen/nmt.hpp>
#include <regista/canopen/object_dictionary.hpp>
#include <regista/canopen/sdo_server.hpp>

namespace regista::canopen {

/// A node with an object dictionary, for simulated drives: NMT, heartbeat both ways, node guarding, SDO server, PDOs of
/// all kinds as the dictionary has them (1400 to 1BFF), SYNC, EMCY and LSS. Passive, as the Master is.
class Slave final : public Station, SdoObjects {
 public:
  struct Events {
    /// An object was written, by SDO or PDO; it has the new value. An SdoAbort refuses it: then it has the old one
    /// again.
    std::function<std::optional<SdoAbort>(ObjectIndex, ByteView)> written;
    /// An object is about to be read, by SDO or for a PDO: time to set() it.
    std::function<void(ObjectIndex)> reading;
    std::function<void(NmtState)> state;
    /// The master fell silent (EMCY 8130) or an RPDO did not come in time (8250): what 6007 is about.
    std::function<void(std::uint16_t emcy_code)> silent;
  };

  /// With node id 255, it waits for LSS to give it one. Its identity is object 1018.
  Slave(CanBus& bus, NodeId node, ObjectDictionary dictionary, Events events, const SdoServer::Options& sdo);
  Slave(const Slave&) = delete;
  Slave& operator=(const Slave&) = delete;

  void on_frame(const CanFrame& frame, Time now) override;
  void on_time(Time now) override;
  [[nodiscard]] Time next_wake() const override;

  [[nodiscard]] NodeId node() const { return node_; }
  [[nodiscard]] NmtState state() const { return state_; }
  /// An integer object; 0 if there is none.
  [[nodiscard]] std::uint64_t get(ObjectIndex object) const;
  /// Sets an object as the device itself; cut to its size. A PDO with it that goes on events goes at the next on_time.
  void set(ObjectIndex object, std::uint64_t value);
  /// Objects of any kind.
  [[nodiscard]] const ObjectDictionary& dictionary() const { return dictionary_; }
  void set_bytes(ObjectIndex object, ByteView bytes);
  /// Tells an error, or with code 0 that all are gone; also into 1001 and 1003.
  void emergency(const Emcy& emcy, Time now);
  /// As after power on: the dictionary as it was, boot-up message, pre-operational.
  void power_on(Time now);

 private:
  struct Pdo {
    std::uint32_t cob_id = 0;
    std::uint8_t transmission = 0;
    bool remote_allowed = false;
    Duration inhibit{};
    Duration event_timer{};
    PdoMapping mapping{};
    std::array<std::uint8_t, 8> bytes{};  ///< received: waits for SYNC; transmitted: sent last
    bool pending = false;
    bool sent = false;
    std::uint8_t syncs = 0;
    std::optional<Time> due{};  ///< of the event timer
    Time inhibited_until = Time::min();
  };

  Result<Bytes> read_object(ObjectIndex object) override;
  Result<> write_object(ObjectIndex object, ByteView data) override;
  [[nodiscard]] std::size_t short_size(ObjectIndex object) const override;
  std::optional<SdoAbort> check_mapping(ObjectIndex object, ByteView data) const;
  std::optional<SdoAbort> change(ObjectIndex object, ByteView data);

  void enter(NmtState state, Time now);
  void reset(bool application, Time now);
  void load_pdos(Time now);
  void load_consumers();
  void on_nmt(const CanFrame& frame, Time now);
  void on_sync(Time now);
  void apply(Pdo& pdo);
  [[nodiscard]] std::array<std::uint8_t, 8> packed(const Pdo& pdo);
  void transmit(Pdo& pdo, Time now);
  void send(const CanFrame& frame);
  void flush(Time now);

  CanBus& bus_;
  NodeId node_;
  ObjectDictionary dictionary_;
  ObjectDictionary pristine_;
  Events events_;
  SdoServer::Options sdo_options_;
  std::optional<SdoServer> sdo_;
  LssSlave lss_;
  NmtState state_ = NmtState::boot_up;
  Time now_;
  bool powered_ = false;
  bool guard_toggle_ = false;
  bool reload_ = false;
  std::vector<Pdo> receive_;
  std::vector<Pdo> transmit_;
  struct Consumer {
    NodeId node = 0;
    Duration time{};
    std::optional<Time> due{};
  };
  std::vector<Consumer> consumers_;
  Time heartbeat_at_ = Time::max();
  std::deque<CanFrame> out_;  ///< at most 64
  Time retry_at_ = Time::max();
};

}  // namespace regista::canopen

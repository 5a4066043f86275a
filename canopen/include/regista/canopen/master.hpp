// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <memory>
#include <regista/canopen/can_bus.hpp>
#include <regista/canopen/emcy.hpp>
#include <regista/canopen/lss.hpp>
#include <regista/canopen/nmt.hpp>
#include <regista/canopen/pdo.hpp>
#include <regista/canopen/sdo_client.hpp>
#include <regista/canopen/sync.hpp>

namespace regista::canopen {

/// The master of one bus. Passive: it acts when it is given a frame or the time, and never blocks; give both from one
/// thread, by serve() or a Pump.
///
/// What it sends waits in four places, each bounded: network management and SYNC go first, then PDOs, of which only the
/// newest of each waits, then SDO and LSS, a frame of each node in turn. When the bus breaks (bus-off, interface down,
/// or nothing sent for `link_timeout`) all of it is discarded and transfers fail with `network_down`: nothing that was
/// meant for before the trouble is sent after it.
class Master final : public Station {
 public:
  struct Options {
    NodeId id = 127;
    /// How often our own heartbeat goes, so that drives stop by themselves when it does not; 0: never, and then nothing
    /// finds out by itself that a bus that was down is up again.
    Duration heartbeat = std::chrono::milliseconds{100};
    Duration link_timeout = std::chrono::milliseconds{500};
    /// When the bus was saturated, how long to wait before it is tried again; about two frames.
    Duration retry = std::chrono::microseconds{500};
    int bit_rate = 0;  ///< [bit/s], for bus_load() only
    SdoClient::Options sdo{};
    SyncProducer::Options sync{};
    LssMaster::Options lss{};
  };

  /// What happens on the bus. Called from on_frame and on_time; may call the master. Empty ones are left out.
  struct Events {
    /// Boot-up messages and changes of state of any node; lost and back of those that are watched.
    std::function<void(NodeId, NodeMonitor::Event)> node;
    std::function<void(NodeId, const Emcy&)> emcy;
    std::function<void(BusState)> bus;
  };

  /// The bus outlives the master. Throws std::invalid_argument on a node id that is none.
  Master(CanBus& bus, const Options& options, Events events);
  Master(const Master&) = delete;
  Master& operator=(const Master&) = delete;

  void on_frame(const CanFrame& frame, Time now) override;
  void on_time(Time now) override;
  [[nodiscard]] Time next_wake() const override;
  /// What was handed in last: the time to use in callbacks.
  [[nodiscard]] Time now() const { return now_; }

  // --- nodes -----------------------------------------------------------------------------------------------------
  /// Supervises a node from now on. Its heartbeat has to be configured at the node too: heartbeat_writes().
  void watch(NodeId node, const NodeMonitor::Options& options);
  [[nodiscard]] const NodeMonitor& monitor(NodeId node) const { return nodes_[node].monitor; }
  [[nodiscard]] const EmcyHistory& emergencies(NodeId node) const { return nodes_[node].emergencies; }
  /// To one node or to all (0). Fails with `network_down` or, with 32 frames waiting, `no_buffer_space`.
  Result<> command(NmtCommand command, NodeId node, Time now);
  /// TIME, to whom it may concern.
  Result<> send_time(std::chrono::sys_time<std::chrono::milliseconds> time, Time now);

  // --- SDO -------------------------------------------------------------------------------------------------------
  /// Read or write an object; `done` is called once, later. Transfers of one node follow each other in order, up to 64
  /// of them wait; those of several nodes go side by side. Fails as command() does.
  Result<> upload(NodeId node, ObjectIndex object, SdoDone done, Time now,
                  SdoTransfer transfer = SdoTransfer::standard);
  Result<> download(NodeId node, ObjectIndex object, Bytes data, SdoDone done, Time now,
                    SdoTransfer transfer = SdoTransfer::standard);
  /// Writes all in order and then reads back what asks for it and can be read; stops at the first error. One such a
  /// node at a time.
  Result<> configure(NodeId node, std::vector<SdoWrite> writes, std::function<void(Result<>)> done, Time now);
  /// Objects 1018:01 to 04; all but the first may be missing and are then 0.
  Result<> identify(NodeId node, std::function<void(Result<Identity>)> done, Time now);

  // --- PDO -------------------------------------------------------------------------------------------------------
  using PdoHandler = std::function<void(ByteView bytes, Time now)>;
  /// Calls `handler` for each PDO with this 11-bit id. While setting up; up to 255.
  void on_pdo(std::uint32_t cob_id, PdoHandler handler);
  /// A PDO that we send. While setting up. Of `synchronous` ones, what was set between two SYNCs goes out together
  /// behind the second, and takes effect in all nodes together with the third.
  std::size_t add_pdo(std::uint32_t cob_id, std::uint8_t size, bool synchronous);
  /// Sends it, or has it replace what waits. Fails with `network_down`: then nothing is kept.
  Result<> send_pdo(std::size_t pdo, std::span<const std::uint8_t, 8> bytes, Time now);
  /// Asks for a PDO by a remote frame.
  Result<> request_pdo(std::uint32_t cob_id, std::uint8_t size, Time now);
  /// Forgets the PDOs that wait: what an emergency stop begins with.
  void discard_pdos();

  /// One service at a time; see there. Call on_time() after starting one, to send it at once.
  LssMaster& lss() { return lss_; }

  // --- diagnosis ---------------------------------------------------------------------------------------------------
  struct Statistics {
    std::uint64_t sent = 0;
    std::uint64_t received = 0;
    std::uint64_t error_frames = 0;
    std::uint64_t saturated = 0;                  ///< times that the bus took no frame
    std::uint64_t replaced_pdos = 0;              ///< by a newer one, before they were sent
    std::uint64_t discarded = 0;                  ///< frames, because the bus broke
    std::uint64_t late_pdos = 0;                  ///< synchronous, that missed the window
    std::optional<std::uint8_t> transmit_errors;  ///< of the controller, where it tells
    std::optional<std::uint8_t> receive_errors;
  };
  [[nodiscard]] const Statistics& statistics() const { return statistics_; }
  [[nodiscard]] BusState bus_state() const { return bus_state_; }
  /// Share of the bus that was taken in the last full second, 0 to 1; 0 if the bit rate is not known.
  [[nodiscard]] double bus_load() const { return bus_load_; }
  [[nodiscard]] const SyncProducer& sync() const { return sync_; }
  [[nodiscard]] const Options& options() const { return options_; }

 private:
  struct Transfer {
    ObjectIndex object;
    bool read = true;
    Bytes data{};
    SdoTransfer transfer = SdoTransfer::standard;
    SdoDone done{};
  };
  struct Channel {
    SdoClient client;
    std::deque<Transfer> waiting{};
    bool configuring = false;
  };
  struct Node {
    NodeMonitor monitor;
    EmcyHistory emergencies{};
    std::unique_ptr<Channel> channel{};
  };
  struct OutgoingPdo {
    CanFrame frame;
    bool synchronous = false;
    bool pending = false;  ///< to be sent
    bool armed = false;    ///< synchronous: waits for its SYNC
  };
  struct Configuration;

  [[nodiscard]] bool broken() const { return bus_state_ == BusState::off || bus_state_ == BusState::down; }
  Result<> unless_broken(const char* what) const;
  Result<> urgent(const CanFrame& frame, Time now);
  Result<> enqueue(NodeId node, Transfer transfer, Time now);
  void start_next(Channel& channel, Time now);
  void step(const std::shared_ptr<Configuration>& job);
  void set_bus_state(BusState state, Time now);
  void discard_all(Time now);
  void tell(NodeId node, NodeMonitor::Event event);
  /// True: taken. False: try again later.
  bool put(const CanFrame& frame, Time now);
  void flush(Time now);
  [[nodiscard]] bool waiting() const;
  void count_bits(const CanFrame& frame, Time now);

  CanBus& bus_;
  Options options_;
  Events events_;
  std::vector<Node> nodes_;
  std::vector<NodeId> watched_;
  std::vector<Channel*> channels_;
  std::size_t turn_ = 0;
  std::array<CanFrame, 32> urgent_{};
  std::size_t urgent_count_ = 0;
  std::vector<OutgoingPdo> outgoing_;
  std::vector<PdoHandler> handlers_;
  std::array<std::uint8_t, 0x800> handler_of_{};  ///< position in handlers_, plus one
  SyncProducer sync_;
  LssMaster lss_;
  Time now_;
  Time heartbeat_at_ = Time::min();
  Time retry_at_ = Time::min();
  std::optional<Time> blocked_since_;
  bool booted_ = false;
  BusState bus_state_ = BusState::active;
  Statistics statistics_;
  Time load_since_;
  std::int64_t load_bits_ = 0;
  double bus_load_ = 0;
};

/// The writes that make a node send its heartbeat every `producer`, and watch the master's with `consumer`; 0 leaves an
/// entry as it is. The consumer goes into 1016:01.
std::vector<SdoWrite> heartbeat_writes(NodeId master, std::chrono::milliseconds producer,
                                       std::chrono::milliseconds consumer);

}  // namespace regista::canopen

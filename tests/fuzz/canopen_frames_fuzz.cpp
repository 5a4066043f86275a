// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <regista/canopen/candump.hpp>
#include <regista/canopen/eds.hpp>
#include <regista/canopen/master.hpp>
#include <regista/canopen/slave.hpp>
#include <regista/canopen/socketcand.hpp>
#include <regista/canopen/virtual_bus.hpp>

using namespace regista;
using namespace regista::canopen;

namespace {

/// The search goes on until one of these aborts.
void require(bool condition) {
  if (!condition) std::abort();
}

/// Small, with PDOs, so that most of what comes finds something to do.
constexpr const char* eds = R"([1000]
ParameterName=Device type
DataType=7
AccessType=ro
[1014]
ParameterName=COB-ID EMCY
DataType=7
DefaultValue=0x85
[1016]
ParameterName=Consumer heartbeat time
ObjectType=8
DataType=7
CompactSubObj=1
[1017]
ParameterName=Producer heartbeat time
DataType=6
[1018]
ParameterName=Identity
ObjectType=8
DataType=7
CompactSubObj=4
[1400]
ParameterName=RPDO
ObjectType=8
DataType=7
CompactSubObj=6
[1400Value]
NrOfEntries=0
[1600]
ParameterName=Map
ObjectType=9
[1600sub0]
ParameterName=n
DataType=5
DefaultValue=1
[1600sub1]
ParameterName=1
DataType=7
DefaultValue=0x20000020
[1800]
ParameterName=TPDO
ObjectType=9
[1800sub1]
ParameterName=COB-ID
DataType=7
DefaultValue=0x185
[1800sub2]
ParameterName=type
DataType=5
DefaultValue=1
[1800sub3]
ParameterName=inhibit
DataType=6
[1800sub5]
ParameterName=timer
DataType=6
[1A00]
ParameterName=Map
ObjectType=9
[1A00sub0]
ParameterName=n
DataType=5
DefaultValue=1
[1A00sub1]
ParameterName=1
DataType=7
DefaultValue=0x20000020
[2000]
ParameterName=Value
DataType=7
PDOMapping=1
[2001]
ParameterName=Domain
DataType=15
)";

struct Talk {
  VirtualBus bus{1'000'000, 64};
  VirtualBus::Port& master_end = bus.attach();
  VirtualBus::Port& slave_end = bus.attach();
  int done = 0;
  int begun = 0;
  Master master{master_end, {.sync = {.period = std::chrono::milliseconds{10}}}, {}};
  Slave slave{slave_end, 5, parse_eds(eds, "fuzz", NodeId{5}), {}, {}};
  Time now = Time{} + std::chrono::hours{1};

  void pass(Duration duration) {
    now += duration;
    bus.on_time(now);
    require(static_cast<bool>(serve(master_end, master, now)));
    require(static_cast<bool>(serve(slave_end, slave, now)));
  }
  void transfer(bool read, SdoTransfer kind) {
    if (begun - done >= 4) return;
    const auto count = [this](const Result<Bytes>&) { ++done; };
    const Result<> started = read ? master.upload(5, {0x2001, 0}, count, now, kind)
                                  : master.download(5, {0x2001, 0}, Bytes(40, 1), count, now, kind);
    begun += started ? 1 : 0;
  }
};

}  // namespace

/// Each 12 bytes are a frame that the master and the slave get, or time that passes, or a transfer that begins. Every
/// transfer ends, once.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Talk talk;
  talk.pass({});
  for (std::size_t at = 0; at + 12 <= size && at < 12 * 400; at += 12) {
    const std::uint8_t* record = data + at;
    CanFrame frame{.id = static_cast<std::uint32_t>(record[0] | record[1] << 8),
                   .extended = (record[2] & 1U) != 0,
                   .remote = (record[2] & 2U) != 0,
                   .error = (record[2] & 4U) != 0,
                   .size = static_cast<std::uint8_t>(record[3] % 9)};
    frame.id &= frame.extended ? 0x1FFFFFFFU : frame.error ? 0xFFFFU : 0x7FFU;
    if (!frame.remote) std::copy_n(record + 4, frame.size, frame.data.begin());
    switch (record[2] >> 4) {
      case 0:
        talk.pass(std::chrono::milliseconds{record[3]});
        break;
      case 1:
        talk.transfer((record[3] & 1U) != 0, (record[3] & 2U) != 0 ? SdoTransfer::block : SdoTransfer::standard);
        break;
      default:
        talk.master.on_frame(frame, talk.now);
        if (!frame.error) talk.slave.on_frame(frame, talk.now);
        talk.pass(std::chrono::microseconds{200});
    }
    (void)describe(frame);
    const auto back = parse_log_line(to_string(LogEntry{1.5, "can0", frame}));
    require(frame.error || (back && back->frame == frame));
  }
  for (int i = 0; i < 400 && talk.done < talk.begun; ++i) talk.pass(std::chrono::milliseconds{50});
  require(talk.done == talk.begun);

  const std::string_view text{reinterpret_cast<const char*>(data), size};
  (void)parse_log_line(text);
  if (const auto frame = parse_socketcand(text)) require(frame->size <= 8);
  if (const auto writes = parse_concise_dcf({data, size})) {
    const Bytes again = concise_dcf(*writes);
    require(std::equal(again.begin(), again.end(), data, data + size));
  }
  return 0;
}

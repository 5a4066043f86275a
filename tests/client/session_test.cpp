// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <regista/client/robot.hpp>

#include "scripted_server.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using test::Message;
using test::Peer;

json recorded(const std::string& name) {
  std::ifstream file{std::string{TEST_DATA} + "/player-session-" + name + ".json"};
  return json::parse(file);
}

/// The stock server's side of a session, byte for byte: sends what it sent once the client has sent, byte for byte,
/// what the stock client had sent before. What our client says beyond that is answered as the stock server does.
class StockServer {
 public:
  explicit StockServer(json session) : session_(std::move(session)) {}  // braces would make it an array

  void operator()(Peer& peer) const {
    for (const json& chunk : session_["chunks"]) {
      if (!chunk.contains("hex")) break;  // closed
      const test::Bytes bytes = test::from_hex(chunk["hex"]);
      if (chunk["dir"] == "s2c") {
        EXPECT_TRUE(peer.send(bytes));
        continue;
      }
      for (std::size_t at = 0; at < bytes.size();) {
        Message expected{test::Bytes{bytes.substr(at, 40)}, {}};
        expected.body = test::Bytes{bytes.substr(at + 40, expected.header.u32_at(36))};
        at += 40 + expected.body.size();
        if (!expect(peer, expected)) return;
      }
    }
    while (const auto message = peer.next()) peer.nack(*message);  // the last DEVLIST: that it answers is enough
  }

 private:
  static bool expect(Peer& peer, const Message& expected) {
    std::optional<Message> message = peer.next();
    if (message && message->is(1, test::request_type, 100)) {
      peer.nack(*message);  // EXTEND: unknown to a stock server
      message = peer.next();
    }
    if (!message) {
      ADD_FAILURE() << "the client is gone before " << expected.interface() << '/' << expected.subtype();
      return false;
    }
    EXPECT_EQ(message->host(), expected.host());
    EXPECT_EQ(message->robot() == 0, expected.robot() == 0);
    EXPECT_EQ(message->interface(), expected.interface());
    EXPECT_EQ(message->index(), expected.index());
    EXPECT_EQ(message->type(), expected.type());
    EXPECT_EQ(message->subtype(), expected.subtype());
    EXPECT_EQ(message->body, expected.body) << "body of " << expected.interface() << '/' << expected.subtype();
    return message->is(expected.interface(), expected.type(), expected.subtype());
  }

  json session_;
};

void expect_equal(const position2d::State& state, const json& fields) {
  EXPECT_EQ(state.pose.x, fields["pos"]["px"].get<double>());
  EXPECT_EQ(state.pose.y, fields["pos"]["py"].get<double>());
  EXPECT_EQ(state.pose.heading, fields["pos"]["pa"].get<double>());
  EXPECT_EQ(state.velocity.x, fields["vel"]["px"].get<double>());
  EXPECT_EQ(state.velocity.y, fields["vel"]["py"].get<double>());
  EXPECT_EQ(state.velocity.w, fields["vel"]["pa"].get<double>());
  EXPECT_EQ(state.stalled, fields["stall"].get<int>());
}

/// Does what the recorded client did, through our proxies, and compares all that it gets to see.
void replay(const std::string& name, int least_reads) {
  const json session = recorded(name);
  const json& messages = session["messages"];
  const test::ScriptedServer server{StockServer(session)};
  client::Robot robot{"127.0.0.1", server.port(), {.mode = player::DataMode::pull}};
  EXPECT_FALSE(robot.connection().extended());
  EXPECT_EQ(robot.connection().server(), "Player v.3.1.1-dev");

  int reads = 0;
  std::vector<client::Robot::Device> devices;
  std::size_t driver_infos = 0;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    const json& message = messages[i];
    if (message["dir"] != "c2s") continue;
    // What came in answer, up to the client's next word: the reply, and the last state.
    const json* reply = nullptr;
    const json* newest = nullptr;
    for (std::size_t j = i + 1; j < messages.size() && messages[j]["dir"] == "s2c"; ++j) {
      if (messages[j]["type"] == "RESP_ACK") reply = &messages[j];
      if (messages[j]["name"] == "position2d.STATE") newest = &messages[j];
    }
    const std::string what = message["name"];
    const json& fields = message["fields"];
    SCOPED_TRACE(name + " message " + std::to_string(i) + " " + what);
    if (what == "player.DEV" && fields["access"] == 1) {
      const bool is_base = fields["addr"]["interf"] == 4;
      client::ProxyBase& proxy = is_base ? static_cast<client::ProxyBase&>(robot.position2d())
                                         : static_cast<client::ProxyBase&>(robot.power());
      if (reply != nullptr) {
        EXPECT_EQ(proxy.driver() + '\0', (*reply)["fields"]["driver_name"].get<std::string>());
      }
    } else if (what == "player.DEV") {
      break;  // closing: in the end
    } else if (what == "player.DATA") {
      ASSERT_NE(newest, nullptr);
      const auto& sample = robot.position2d().latest<position2d::State>();
      while (sample.stamp_s < (*newest)["timestamp"].get<double>()) ASSERT_TRUE(robot.read(1s));
      expect_equal(sample.value, (*newest)["fields"]);
      EXPECT_LT(robot.position2d().age(), 1s);
      ++reads;
    } else if (what == "position2d.VEL") {
      const json& velocity = fields["vel"];
      robot.position2d().set_velocity({velocity["px"], velocity["py"], velocity["pa"]});
    } else if (what == "position2d.POS") {
      const json& pose = fields["pos"];
      const json& limits = fields["vel"];
      robot.position2d().go_to({pose["px"], pose["py"], pose["pa"]}, {limits["px"], limits["py"], limits["pa"]});
    } else if (what == "position2d.GET_GEOM") {
      const position2d::State before = robot.position2d().state();
      const position2d::Geometry geometry = robot.position2d().geometry();
      EXPECT_EQ(robot.position2d().state(), before) << "values change in read() only";
      const json& expected = (*reply)["fields"];
      EXPECT_EQ(geometry.pose.x, expected["pose"]["px"].get<double>());
      EXPECT_EQ(geometry.pose.yaw, expected["pose"]["pyaw"].get<double>());
      EXPECT_EQ(geometry.size.length, expected["size"]["sl"].get<double>());
      EXPECT_EQ(geometry.size.width, expected["size"]["sw"].get<double>());
    } else if (what == "position2d.SET_ODOM") {
      const json& pose = fields["pose"];
      robot.position2d().set_odometry({pose["px"], pose["py"], pose["pa"]});
    } else if (what == "player.DEVLIST") {
      devices = robot.devices();  // and all DRIVERINFO that follow
      ASSERT_EQ(devices.size(), (*reply)["fields"]["devices"].size());
    } else if (what == "player.DRIVERINFO") {
      ASSERT_LT(driver_infos, devices.size());
      const client::Robot::Device& device = devices[driver_infos++];
      EXPECT_EQ(device.address.interface, fields["addr"]["interf"].get<int>());
      EXPECT_EQ(device.address.index, fields["addr"]["index"].get<int>());
      EXPECT_EQ(device.driver + '\0', (*reply)["fields"]["driver_name"].get<std::string>());
    } else if (what == "player.ADD_REPLACE_RULE") {
      const auto done = robot.connection().request(
          client::server_address, player::AddReplaceRule{fields["interf"], fields["index"], fields["type"],
                                                         fields["subtype"], fields["replace"]});
      EXPECT_TRUE(done);
    } else {
      EXPECT_EQ(what, "player.DATAMODE");
    }
  }
  EXPECT_GE(reads, least_reads);
  EXPECT_EQ(robot.connection().counters().stray, 0u);
  EXPECT_EQ(robot.connection().counters().undecodable, 0u);
  EXPECT_EQ(robot.connection().counters().unwanted, 0u);
}

TEST(Session, of_libplayercpp_replayed_byte_for_byte_drives_our_proxies) { replay("libplayercpp", 5); }
TEST(Session, of_playerprint_replayed_byte_for_byte_drives_our_proxies) { replay("playerprint", 15); }

}  // namespace
}  // namespace regista

// SPDX-License-Identifier: Apache-2.0
#include "../fakes/plugins/fake_base.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <regex>

#include "bench.hpp"

namespace regista {
namespace {

using namespace std::chrono_literals;

Bench fake(const std::string& keys) { return Bench::of<FakeBase>("provides [\"position2d:0\"] " + keys); }

TEST(FakeBase, records_what_is_done_to_it) {
  int ends[2];
  ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
  {
    Bench bench = fake("log \"/dev/fd/" + std::to_string(ends[1]) + '"');
    bench.send(position2d::VelocityCommand{.velocity = {.x = 0.5, .w = -1}});
    bench.host().shut_down(bench.now());
  }
  ::close(ends[1]);
  std::string log(1000, '\0');
  log.resize(static_cast<std::size_t>(::read(ends[0], log.data(), log.size())));
  ::close(ends[0]);
  EXPECT_EQ(std::regex_replace(log, std::regex{"(^|\n)[0-9]+ "}, "$1"),
            "open\nvelocity 0.5 0 -1\nread\nvelocity 0 0 0\nhalt\nclose\n");
}

TEST(FakeBase, echoes_a_command_before_the_beat) {
  Bench bench = fake("echo yes samples 0");
  bench.send(position2d::VelocityCommand{.velocity = {.x = 0.5}});
  ASSERT_EQ(bench.samples().size(), 1U);
  EXPECT_EQ(bench.latest<position2d::State>().velocity.x, 0.5);
}

TEST(FakeBase, throws_in_the_call_it_is_told_to) {
  for (const std::string call : {"read", "publish", "command", "request"}) {
    Bench bench = fake("fault \"throw\" after 1 at \"" + call + '"');
    ASSERT_TRUE(bench.subscribed());
    for (int i = 0; i < 2; ++i) {
      bench.send(position2d::VelocityCommand{});
      (void)bench.ask(position2d::GetGeometry{});
      bench.run(10ms);
    }
    EXPECT_EQ(bench.host().metrics().faults, 1U) << call;
    bench.run(2s);
    EXPECT_TRUE(bench.host().metrics().open) << call;
  }
}

TEST(FakeBase, fails_to_open_as_often_as_it_is_told_to) {
  Bench bench = fake("fault \"error\" at \"open\" times 2");
  ASSERT_FALSE(bench.subscribed());
  EXPECT_NE(bench.subscribed().error().what.find("made-up fault"), std::string::npos);
  EXPECT_FALSE(bench.ask(player::Subscribe{}));
  EXPECT_TRUE(bench.ask(player::Subscribe{}));
}

TEST(FakeBase, hangs_for_its_seconds) {
  Bench bench = fake("fault \"hang\" at \"command\" seconds 0.02");
  const Time before = Clock::now();
  bench.send(position2d::VelocityCommand{});
  EXPECT_GE(Clock::now() - before, 20ms);
}

TEST(FakeBase, floods) {
  Bench bench = fake("samples 300");
  bench.samples().clear();
  bench.run(10ms);
  EXPECT_GT(bench.samples().size(), 60U) << "as many as wait, and the newest";
}

TEST(FakeBaseDeathTest, segfaults) {
  Bench bench = fake("fault \"segfault\" at \"command\"");
  const auto crash = [&] {
    (void)std::signal(SIGSEGV, SIG_DFL);  // sanitizers have a handler of their own
    bench.send(position2d::VelocityCommand{});
  };
  EXPECT_EXIT(crash(), testing::KilledBySignal(SIGSEGV), "");
}

TEST(FakeBase, knows_its_words) { EXPECT_THROW((void)fake("fault \"trow\""), ConfigError); }

}  // namespace
}  // namespace regista

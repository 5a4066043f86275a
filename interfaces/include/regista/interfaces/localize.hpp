// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <regista/interfaces/message.hpp>

/// Where the robot believes to be.
namespace regista::localize {

inline constexpr std::uint16_t code = 25;

struct Hypothesis {
  Pose2d mean{};
  std::array<double, 6> covariance{};
  double weight = 0;

  static constexpr auto fields =
      Fields{Field<&Hypothesis::mean>{"mean"},
             Field<&Hypothesis::covariance>{"cov", "", "xx, yy [m^2], aa [rad^2], xy, ya, xa"},
             Field<&Hypothesis::weight>{"alpha", "", "in [0, 1]"}};
  friend bool operator==(const Hypothesis&, const Hypothesis&) = default;
};

struct State {
  std::uint32_t pending_count = 0;
  double pending_time_s = 0;
  std::vector<Hypothesis> hypotheses{};

  static constexpr Message message{code, Kind::data, 1, "HYPOTHS"};
  static constexpr auto fields =
      Fields{Field<&State::pending_count>{"pending_count", "", "observations that wait"},
             Field<&State::pending_time_s>{"pending_time", "s", "since the epoch, of the last one processed"},
             Field<&State::hypotheses>{"hypoths"}};
  friend bool operator==(const State&, const State&) = default;
};

/// The robot is here, as far as we know.
struct SetPose {
  Pose2d mean{};
  std::array<double, 6> covariance{};

  using Reply = Empty;
  static constexpr Message message{code, Kind::request, 1, "SET_POSE"};
  static constexpr auto fields = Fields{Field<&SetPose::mean>{"mean"},
                                        Field<&SetPose::covariance>{"cov", "", "xx, yy [m^2], aa [rad^2], xy, ya, xa"}};
  friend bool operator==(const SetPose&, const SetPose&) = default;
};

struct Particle {
  Pose2d pose{};
  double weight = 0;

  static constexpr auto fields = Fields{Field<&Particle::pose>{"pose"}, Field<&Particle::weight>{"alpha"}};
  friend bool operator==(const Particle&, const Particle&) = default;
};

struct GetParticles {
  Pose2d mean{};
  double variance = 0;
  std::vector<Particle> particles{};

  using Reply = GetParticles;
  static constexpr Message message{code, Kind::request, 2, "GET_PARTICLES"};
  static constexpr auto fields = Fields{Field<&GetParticles::mean>{"mean"}, Field<&GetParticles::variance>{"variance"},
                                        Field<&GetParticles::particles>{"particles"}};
  friend bool operator==(const GetParticles&, const GetParticles&) = default;
};

}  // namespace regista::localize

namespace regista {

struct Localize {
  static constexpr std::uint16_t code = localize::code;
  static constexpr std::string_view name = "localize";
  using Messages = TypeList<localize::State, localize::SetPose, localize::GetParticles>;
};

}  // namespace regista

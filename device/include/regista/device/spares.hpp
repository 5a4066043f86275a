// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <regista/interfaces/messages.hpp>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace regista {

/// The memory of messages that a queue's places do not hold just now: a place that changes its kind gives the old
/// message up here, and takes one of the new kind from here, so that their arrays are not made again and again.
///
/// Bounded by the queue: a message is made only when there is no spare one of its kind, and so there are never more
/// than there are places. The producer's thread only.
template <typename Variant, typename Messages = typename Variant::Messages>
class Spares;

template <typename Variant, typename... Ms>
class Spares<Variant, TypeList<Ms...>> {
 public:
  /// Write `message` to `place`, over whatever it held.
  template <typename M>
  void assign(Variant& place, const M& message) {
    constexpr std::size_t kind = index_in<M>(TypeList<Ms...>{});
    if (place.index() != kind) {
      Variant other{std::in_place_type<M>};
      if (!spares_[kind].empty()) {
        other = std::move(spares_[kind].back());
        spares_[kind].pop_back();
      }
      std::swap(place, other);
      if (owns_memory[other.index()]) spares_[other.index()].push_back(std::move(other));
    }
    *std::get_if<M>(&place) = message;
  }

 private:
  static constexpr std::array<bool, sizeof...(Ms)> owns_memory{!std::is_trivially_destructible_v<Ms>...};

  std::array<std::vector<Variant>, sizeof...(Ms)> spares_;  ///< by kind
};

}  // namespace regista

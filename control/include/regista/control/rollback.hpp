// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <regista/control/measurement.hpp>
#include <regista/core/time.hpp>
#include <utility>

namespace regista::control {

/// What Rollback needs: a filter whose whole memory is its State.
template <typename Filter>
concept Restorable = requires(Filter filter, const Filter& constant, const typename Filter::Input& input,
                              const typename Filter::Measurement& measurement, Duration dt) {
  filter.predict(input, dt);
  { filter.correct(measurement) } -> std::same_as<Correction>;
  { constant.state() } -> std::same_as<const typename Filter::State&>;
  filter.restore(constant.state());
};

/// A filter whose measurements may be late and out of order: it goes back to the time of the measurement, corrects
/// there, and repeats what came after, in the order of the measurements' own times. The result is that of a filter
/// that got everything in time, gates included. A step costs one copy of the state more, a late measurement the
/// repetition. Remembers the last `capacity` steps and measurements, in fixed memory.
template <Restorable Filter, std::size_t capacity = 256>
class Rollback {
 public:
  using Input = typename Filter::Input;
  using Measurement = typename Filter::Measurement;

  explicit Rollback(Filter filter) : filter_{std::move(filter)} { forget(); }

  void predict(const Input& input, Duration dt) {
    filter_.predict(input, dt);
    insert(count_, {.time = entry(count_ - 1).time + std::max(dt, Duration::zero()),
                    .input = input,
                    .measurement = {},
                    .after = filter_.state()});
  }

  /// `age`: how long before the end of the last step it was measured. One from before the history, or from the
  /// future, is refused and counted.
  Correction correct(const Measurement& measurement, Duration age = Duration::zero()) {
    if (age < Duration::zero() || age > reach()) {
      ++too_old_;
      return {.verdict = Verdict::too_old};
    }
    const Duration captured = entry(count_ - 1).time - age;
    std::size_t at = count_ - 1;
    while (entry(at).time > captured) --at;
    filter_.restore(entry(at).after);
    Correction result;
    if (entry(at).time < captured || entry(at).measurement) {
      // Cut the step during which it was measured.
      const Input input = entry(std::min(at + 1, count_ - 1)).input;
      if (entry(at).time < captured) filter_.predict(input, captured - entry(at).time);
      result = filter_.correct(measurement);
      at = insert(at + 1, {.time = captured, .input = input, .measurement = measurement, .after = filter_.state()});
    } else {
      result = filter_.correct(measurement);
      entry(at).measurement = measurement;
      entry(at).after = filter_.state();
    }
    for (++at; at < count_; ++at) {
      filter_.predict(entry(at).input, entry(at).time - entry(at - 1).time);
      if (entry(at).measurement) filter_.correct(*entry(at).measurement);
      entry(at).after = filter_.state();
    }
    return result;
  }

  /// The filter as of the last step.
  [[nodiscard]] const Filter& filter() const { return filter_; }

  /// Go on with another filter, without a past.
  void replace(Filter filter) {
    filter_ = std::move(filter);
    forget();
  }

  /// How far back a measurement may be now.
  [[nodiscard]] Duration reach() const { return entry(count_ - 1).time - entry(0).time; }
  /// Measurements refused for their age.
  [[nodiscard]] std::uint64_t too_old() const { return too_old_; }

 private:
  struct Entry {
    Duration time{};  ///< at the end of the step
    Input input{};    ///< during the step
    std::optional<Measurement> measurement;
    typename Filter::State after;
  };

  Entry& entry(std::size_t i) { return entries_[(first_ + i) % capacity]; }
  const Entry& entry(std::size_t i) const { return entries_[(first_ + i) % capacity]; }

  /// Before entry `at`; a full history loses its oldest. Returns where it is now.
  std::size_t insert(std::size_t at, const Entry& added) {
    if (count_ == capacity) {
      first_ = (first_ + 1) % capacity;
      --count_;
      --at;
    }
    for (std::size_t i = count_; i > at; --i) entry(i) = entry(i - 1);
    ++count_;
    entry(at) = added;
    return at;
  }

  void forget() {
    first_ = 0;
    count_ = 1;
    entries_[0] = {.time = {}, .input = {}, .measurement = {}, .after = filter_.state()};
  }

  Filter filter_;
  std::array<Entry, capacity> entries_;
  std::size_t first_ = 0;
  std::size_t count_ = 0;
  std::uint64_t too_old_ = 0;
};

}  // namespace regista::control

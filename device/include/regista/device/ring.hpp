// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace regista {

/// Bounded queue between exactly two threads; wait-free; refuses when full. Elements are written and read in place and
/// stay constructed, so that their memory is used again.
template <typename T, std::size_t capacity>
class Ring {
  static_assert((capacity & (capacity - 1)) == 0, "a power of two");

 public:
  /// Producer: the element to fill, or null when fewer than `reserve` + 1 are free.
  T* claim(std::size_t reserve = 0) {
    const std::size_t at = written_.load(std::memory_order_relaxed);
    if (at - read_seen_ + reserve >= capacity) {
      read_seen_ = read_.load(std::memory_order_acquire);
      if (at - read_seen_ + reserve >= capacity) return nullptr;
    }
    return &(*elements_)[at % capacity];
  }
  /// Producer: hand the claimed element over.
  void push() { written_.store(written_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

  /// Consumer: the oldest element, or null.
  T* front() {
    const std::size_t at = read_.load(std::memory_order_relaxed);
    if (at == written_seen_) {
      written_seen_ = written_.load(std::memory_order_acquire);
      if (at == written_seen_) return nullptr;
    }
    return &(*elements_)[at % capacity];
  }
  /// Consumer: give the element back to the producer.
  void pop() { read_.store(read_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

  /// Either thread, or a third: how many wait, roughly.
  [[nodiscard]] std::size_t size() const {
    return written_.load(std::memory_order_relaxed) - read_.load(std::memory_order_relaxed);
  }

 private:
  // A line each, so that the threads do not take it from one another.
  alignas(64) std::atomic<std::size_t> written_{0};
  std::size_t read_seen_ = 0;
  alignas(64) std::atomic<std::size_t> read_{0};
  std::size_t written_seen_ = 0;
  alignas(64) std::unique_ptr<std::array<T, capacity>> elements_ = std::make_unique<std::array<T, capacity>>();
};

/// The newest value, handed from one thread to one other; wait-free; memory is used again.
template <typename T>
class Latest {
 public:
  /// Producer: fill this, then publish().
  T& back() { return slots_[back_]; }
  /// Producer. True: a value that nobody took was replaced.
  bool publish() {
    const std::uint8_t old = middle_.exchange(back_ | fresh, std::memory_order_acq_rel);
    back_ = old & index;
    return (old & fresh) != 0;
  }
  /// Consumer: the newest value since the last take, or null. Valid until the next take.
  T* take() {
    if ((middle_.load(std::memory_order_relaxed) & fresh) == 0) return nullptr;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & index;
    return &slots_[front_];
  }

 private:
  static constexpr std::uint8_t fresh = 4;
  static constexpr std::uint8_t index = 3;
  std::array<T, 3> slots_{};
  std::uint8_t back_ = 0;
  std::atomic<std::uint8_t> middle_{1};
  std::uint8_t front_ = 2;
};

/// A queue between two threads in which nothing is lost that must not be, and the newest wins where that is wanted.
///
/// An item of a *lane* (the states of one device, the set-points of one command) may be replaced by a newer one of its
/// lane when the queue holds a quarter of what it can; the rest is kept for items without a lane, which are refused
/// when it is full. A short wait keeps every item; after a long one, stale items would only delay the new.
template <typename T, std::size_t capacity>
class Mailbox {
 public:
  static constexpr std::size_t no_lane = static_cast<std::size_t>(-1);

  /// Before the threads run. Gives the number of a new lane.
  std::size_t add_lane() {
    lanes_.push_back(std::make_unique<Lane>());
    return lanes_.size() - 1;
  }

  /// Producer: `fill(T&)` writes the item in place, over an old one. False: full, and the item was refused.
  template <typename Fill>
  bool put(std::size_t lane, Fill&& fill) {
    Item* item = ring_.claim(lane == no_lane ? 0 : capacity - capacity / 4);
    if (item == nullptr && lane == no_lane) {
      refused_.fetch_add(1, std::memory_order_relaxed);
      return false;
    }
    Item& target = item != nullptr ? *item : lanes_[lane]->newest.back();
    const std::uint64_t number = number_.load(std::memory_order_relaxed) + 1;
    target.number = number;
    fill(target.value);
    if (item != nullptr) {
      ring_.push();
    } else if (lanes_[lane]->newest.publish()) {
      replaced_.fetch_add(1, std::memory_order_relaxed);
    }
    number_.store(number, std::memory_order_release);
    return true;
  }

  /// Consumer: `take(T&)` each item in the order of put(). How many there were.
  template <typename Take>
  std::size_t drain(Take&& take) {
    return take_until(number_.load(std::memory_order_acquire), take);
  }
  /// The same, but of a full queue only about the oldest `most`. True: there are more.
  template <typename Take>
  bool drain_some(std::size_t most, Take&& take) {
    const std::uint64_t newest = number_.load(std::memory_order_acquire);
    const Item* oldest = ring_.front();
    const std::uint64_t until = oldest == nullptr ? newest : std::min(newest, oldest->number + most - 1);
    take_until(until, take);
    return until < newest;
  }

  // Any thread.
  [[nodiscard]] std::size_t size() const { return ring_.size(); }
  [[nodiscard]] std::uint64_t replaced() const { return replaced_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t refused() const { return refused_.load(std::memory_order_relaxed); }

 private:
  struct Item {
    std::uint64_t number = 0;
    T value{};
  };
  struct Lane {
    Latest<Item> newest;
    Item* held = nullptr;  ///< the consumer's: taken from newest, and not given yet
  };

  /// All up to this number: when it was read, everything up to it could be seen. What is newer waits for the next time.
  template <typename Take>
  std::size_t take_until(std::uint64_t until, Take& take) {
    std::size_t count = 0;
    Lane* lane = oldest_lane();
    while (true) {
      Item* item = ring_.front();
      const bool from_lane = lane != nullptr && (item == nullptr || lane->held->number < item->number);
      if (from_lane) item = lane->held;
      if (item == nullptr || item->number > until) return count;
      take(item->value);
      ++count;
      if (from_lane) {
        lane->held = nullptr;
        lane = oldest_lane();
      } else {
        ring_.pop();
      }
    }
  }
  /// Takes what the lanes have; the one whose item is the oldest. What a lane gets later is newer than what it held.
  Lane* oldest_lane() {
    Lane* oldest = nullptr;
    for (const auto& lane : lanes_) {
      if (lane->held == nullptr) lane->held = lane->newest.take();
      if (lane->held != nullptr && (oldest == nullptr || lane->held->number < oldest->held->number))
        oldest = lane.get();
    }
    return oldest;
  }

  Ring<Item, capacity> ring_;
  std::vector<std::unique_ptr<Lane>> lanes_;
  std::atomic<std::uint64_t> number_{0};  ///< of the last item that was put
  std::atomic<std::uint64_t> replaced_{0};
  std::atomic<std::uint64_t> refused_{0};
};

}  // namespace regista

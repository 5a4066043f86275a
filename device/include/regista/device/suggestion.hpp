// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>

namespace regista {

inline constexpr std::size_t longest_suggestion = 64;  ///< [bytes]; for longer words nothing is suggested

/// How many letters must be put in, taken out, changed or swapped with their neighbour to turn one word into the other
/// (Damerau–Levenshtein, no letter edited twice). Neither word may be longer than `longest_suggestion`.
inline std::size_t edit_distance(std::string_view a, std::string_view b) {
  using Row = std::array<std::size_t, longest_suggestion + 1>;
  Row before_last{};
  Row last{};
  Row row{};
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before_last = last;
    last = row;
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = a[i - 1] == b[j - 1] ? 0 : 1;
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before_last[j - 2] + 1);
    }
  }
  return row[b.size()];
}

/// The candidate that somebody may have meant who wrote `word`: within two edits or a third of its length, and at
/// least half of it right. Empty when there is none.
template <typename Candidates>
std::string closest(std::string_view word, const Candidates& candidates) {
  std::string best;
  if (word.size() > longest_suggestion) return best;
  std::size_t limit = std::min(std::max<std::size_t>(2, word.size() / 3), word.size() / 2);
  for (const std::string_view candidate : candidates) {
    if (candidate.size() > longest_suggestion) continue;
    const std::size_t distance = edit_distance(word, candidate);
    if (distance > limit || (distance == limit && !best.empty())) continue;
    best = candidate;
    limit = distance;
  }
  return best;
}

/// "; did you mean 'rate'?", or nothing when no candidate is close.
template <typename Candidates>
std::string did_you_mean(std::string_view word, const Candidates& candidates) {
  const std::string best = closest(word, candidates);
  return best.empty() ? best : "; did you mean '" + best + "'?";
}

}  // namespace regista

// SPDX-License-Identifier: Apache-2.0
#include "regista/control/measurement.hpp"

namespace regista::control {

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::none:
      return "nothing yet";
    case Verdict::fused:
      return "fused";
    case Verdict::initialised:
      return "initialised the estimate";
    case Verdict::restarted:
      return "restarted the estimate";
    case Verdict::waiting:
      return "waits for the estimate";
    case Verdict::outlier:
      return "refused: outlier";
    case Verdict::too_fast:
      return "refused: too fast";
    case Verdict::invalid:
      return "refused: invalid";
    case Verdict::too_old:
      return "refused: too old";
  }
  return "unknown";
}

Correction SensorRecord::note(Verdict verdict, double nis) {
  last = {.verdict = verdict, .nis = nis};
  switch (verdict) {
    case Verdict::restarted:
      ++restarts;
      [[fallthrough]];
    case Verdict::fused:
    case Verdict::initialised:
      ++taken;
      refused_in_a_row = 0;
      unseen = {};
      break;
    case Verdict::outlier:
    case Verdict::too_fast:
      ++refused_in_a_row;
      [[fallthrough]];
    case Verdict::invalid:
    case Verdict::too_old:
      ++refused;
      break;
    case Verdict::none:
    case Verdict::waiting:
      break;
  }
  return last;
}

}  // namespace regista::control

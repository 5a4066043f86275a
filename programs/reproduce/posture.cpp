// SPDX-License-Identifier: Apache-2.0
#include "experiments.hpp"
namespace reproduce {
std::vector<Experiment> posture_experiments(const Settings&) { return {}; }
}  // namespace reproduce

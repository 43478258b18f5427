#pragma once

#include "helix_arm/model/batch.hpp"
#include "support/paper_arm.hpp"

namespace helix_arm::test {

/// Tips [m] of a section of three of the paper's muscles, at a grid of pressures from 0 to
/// kMaxPressure: so many along each axis, the first actuator's pressure changing fastest.
struct TipGrid {
  std::vector<double> x, y, z;  ///< base frame

  TipGrid(const model::Arm& arm, int per_axis) {
    std::vector<double> q[3];
    for (int i = 0; i < per_axis * per_axis * per_axis; ++i) {
      int rest = i;
      for (auto& axis : q) {
        axis.push_back(kMaxPressure * (rest % per_axis) / (per_axis - 1));
        rest /= per_axis;
      }
    }
    const double* inputs[] = {q[0].data(), q[1].data(), q[2].data()};
    x.resize(q[0].size()), y.resize(x.size()), z.resize(x.size());
    model::TipBatch(arm).columns(inputs, x.size(), x.data(), y.data(), z.data());
  }

  std::size_t count() const { return x.size(); }
  Eigen::Vector3d tip(std::size_t j) const { return {x[j], y[j], z[j]}; }
};

}  // namespace helix_arm::test

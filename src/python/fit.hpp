#pragma once

#include <cstddef>
#include <limits>

#include "arrays.hpp"
#include "helix_arm/estimation/twist_fit.hpp"

namespace helix_arm::python {

/// Fitted shapes, one per row; rows that are not set hold NaN.
class FitArrays {
 public:
  FitArrays(int sections, std::size_t count);
  void set(std::size_t row, const estimation::TwistFit& fit);

 private:
  int sections_;

 public:
  py::array_t<double> twists, covariances, tips, quaternions, tip_covariances, rms;
};

/// Ids of the tags that do not fit, ascending.
py::list outliersOf(const estimation::TwistFit& fit, const estimation::TagLayout& layout);

}  // namespace helix_arm::python

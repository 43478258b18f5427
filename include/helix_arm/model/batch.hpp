#pragma once

#include <cstddef>
#include <memory>

#include "helix_arm/model/arm.hpp"

namespace helix_arm::model {

/// Many inputs in an array, one row each, whatever its strides.
struct InputArray {
  const double* first;           ///< input of actuator 0 in row 0 [Pa or rad]
  std::ptrdiff_t row_stride;     ///< from one row to the next [bytes]
  std::ptrdiff_t column_stride;  ///< from one actuator to the next [bytes]

  double at(std::size_t row, int actuator) const { return *place(row, actuator); }
  const double* place(std::size_t row, int actuator) const {
    return reinterpret_cast<const double*>(reinterpret_cast<const char*>(first) +
                                           static_cast<std::ptrdiff_t>(row) * row_stride +
                                           actuator * column_stride);
  }
};

/// Tip positions of many inputs at once, for point clouds and maps, in one thread. Threads may
/// share it and divide a batch between them: a tip does not depend on the others of its batch.
///
/// Agrees with Arm::tip to 8 eps of the arm's length where no section turns by more than 4.5 rad.
/// Beyond that, the rounding of the twist grows with the angle (24 eps at 7.5 rad), and tips take
/// four times as long. Contractions from a table, and arms not linear, run at scalar speed.
class TipBatch {
 public:
  /// @param arm  outlives the batch.
  explicit TipBatch(const Arm& arm);
  ~TipBatch();

  /// Structure of arrays.
  /// @param inputs  (actuatorCount) pointers to `count` inputs each, inside the limits [Pa or rad];
  ///     not checked.
  /// @param x,y,z   `count` tip coordinates each, base frame [m].
  void columns(const double* const* inputs, std::size_t count, double* x, double* y,
               double* z) const;

  /// Array of structures.
  /// @param inputs  (count, actuatorCount); an array of rows without gaps is the fastest.
  /// @param tips    (count, 3), base frame [m]; must not overlap the inputs.
  /// @return whether all inputs are inside their limits; otherwise the tips mean nothing.
  bool rows(const InputArray& inputs, std::size_t count, double* tips) const;

 private:
  struct Plan;
  std::unique_ptr<const Plan> plan_;
};

}  // namespace helix_arm::model

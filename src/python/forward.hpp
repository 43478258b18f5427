#pragma once

#include <cstdlib>
#include <memory>
#include <optional>

#include "scene.hpp"

namespace helix_arm::python {

/// Shapes at one row or many rows of inputs. Rows without equilibrium hold NaN.
class Forward {
 public:
  Forward(const Scene& scene, const Rows& inputs, std::size_t threads);

  // Views of the numbers, which `self` owns.
  py::array tips(const py::object& self) const;
  py::array quaternions(const py::object& self) const;
  py::array twists(const py::object& self) const;
  py::object converged() const;

  bool single() const { return single_; }
  py::ssize_t rows() const { return rows_; }

 private:
  py::array view(const py::object& self, const double* first,
                 std::initializer_list<py::ssize_t> entry) const;
  void fill(const Scene& scene, const Rows& inputs, std::size_t first, std::size_t end);
  void set(std::size_t row, const lie::SE3& tip, const model::Twists& twists);

  struct Free {
    void operator()(double* numbers) const { std::free(numbers); }
  };
  // Memory without initial values: every entry is written.
  static std::unique_ptr<double[], Free> numbers(std::size_t count);

  bool single_;
  py::ssize_t rows_;
  int sections_;
  std::unique_ptr<double[], Free> numbers_;  // tips, quaternions, twists
  double *tips_, *quaternions_, *twists_;    // in numbers_
  std::unique_ptr<bool[]> converged_;
};

/// Tip positions [m], shape (3,) or (N, 3). Rows without equilibrium hold NaN.
/// @param out  array for them, or none: a new one.
py::array tips(const Scene& scene, const Rows& inputs, const py::object& out, std::size_t threads);

}  // namespace helix_arm::python

#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include "helix_arm/lie/se3.hpp"

/// Arrays of a caller, and those of results.
namespace helix_arm::python {

namespace py = pybind11;
using namespace py::literals;

/// More rows than results can have. Python raises MemoryError.
class TooManyRows : public std::bad_alloc {
 public:
  explicit TooManyRows(std::string message) : message_(std::move(message)) {}
  const char* what() const noexcept override { return message_.c_str(); }

 private:
  std::string message_;
};

/// Rows of numbers in a caller's array, read where they are, whatever its strides. While the
/// interpreter runs other threads, these may write the array: what was checked is then copied,
/// checked again and computed with.
class Rows {
 public:
  /// One row (columns), or many (N, columns). Arrays are float64 and are not copied, except those
  /// that are not aligned; lists and tuples are converted.
  /// @param name  of the argument, for messages.
  /// @throws TypeError on another type or dtype, ValueError on another shape.
  Rows(const py::handle& given, const char* name, py::ssize_t columns);

  const std::string& name() const { return name_; }
  bool single() const { return single_; }  ///< one row, given without the first dimension
  py::ssize_t rows() const { return rows_; }
  py::ssize_t columns() const { return columns_; }
  double operator()(py::ssize_t row, py::ssize_t column) const {
    return *reinterpret_cast<const double*>(data_ + row * row_stride_ + column * column_stride_);
  }
  Eigen::VectorXd row(py::ssize_t row) const;
  /// Shape of a result with one entry per row: what follows is that entry's shape.
  /// @throws TooManyRows naming the argument if no process can hold them.
  std::vector<py::ssize_t> shapeOf(const std::vector<py::ssize_t>& entry) const;
  /// @throws ValueError naming the argument and the row of an entry that is NaN or infinite.
  void requireFinite() const;
  /// Ends a call in which a number broke its rule after all were checked.
  [[noreturn]] void refuseChange() const;

  /// Distances between neighbours [bytes].
  py::ssize_t rowStride() const { return row_stride_; }
  py::ssize_t columnStride() const { return column_stride_; }
  const char* data() const { return data_; }
  const py::array& array() const { return array_; }

 private:
  std::string name_;
  py::array array_;  // keeps the numbers alive
  const char* data_;
  bool single_;
  py::ssize_t rows_, columns_, row_stride_, column_stride_;
};

/// The float64 array of an argument, aligned, of any shape. Throws as Rows does.
py::array argumentArray(const py::handle& given, const char* name);

/// A new array with one entry per row of inputs, which threads without the interpreter write.
template <class Number>
class Entries {
 public:
  /// @param shape  of an entry: {} of a number.
  Entries(const Rows& rows, const std::vector<py::ssize_t>& shape)
      : array_(rows.shapeOf(shape)), first_(array_.mutable_data()) {
    for (const py::ssize_t size : shape) size_ *= size;
  }
  Number* at(std::size_t row) const { return first_ + static_cast<py::ssize_t>(row) * size_; }
  Number& operator[](std::size_t row) const { return *at(row); }
  py::ssize_t size() const { return size_; }  ///< of an entry
  /// The array; the number, if it is but one.
  py::object result() const {
    return array_.ndim() > 0 ? py::object(array_) : array_.attr("item")();
  }

 private:
  py::array_t<Number> array_;
  Number* first_;
  py::ssize_t size_ = 1;
};

/// New array of a vector (n) or a matrix (rows, columns), in the order of C. Numbers given to
/// py::array_t are copied by NumPy, which gives up the interpreter meanwhile: when it ends, a
/// daemon thread is then unwound through its caller.
template <class Derived>
py::array arrayOf(const Eigen::MatrixBase<Derived>& values) {
  std::vector<py::ssize_t> shape{values.rows()};
  if (Derived::ColsAtCompileTime != 1) shape.push_back(values.cols());
  py::array_t<typename Derived::Scalar> out(shape);
  auto* to = out.mutable_data();
  for (Eigen::Index i = 0; i < values.rows(); ++i) {
    for (Eigen::Index j = 0; j < values.cols(); ++j) *to++ = values(i, j);
  }
  return std::move(out);
}

/// Writes a position (3) [m] and a quaternion (4); NaN unless it was found.
void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion);

}  // namespace helix_arm::python

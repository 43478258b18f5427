#pragma once

#include <Eigen/Core>
#include <string>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

namespace helix_arm::python {

namespace py = pybind11;

/// Rows of numbers in a caller's array, read where they are, whatever its strides.
class Rows {
 public:
  /// One row (columns), or many (N, columns). Arrays are float64 and are not copied, except those
  /// that are not aligned; lists and tuples are converted.
  /// @param name  of the argument, for messages.
  /// @throws TypeError on another type or dtype, ValueError on another shape.
  Rows(const py::handle& given, const char* name, py::ssize_t columns);

  bool single() const { return single_; }  ///< one row, given without the first dimension
  py::ssize_t rows() const { return rows_; }
  py::ssize_t columns() const { return columns_; }
  double operator()(py::ssize_t row, py::ssize_t column) const {
    return *reinterpret_cast<const double*>(data_ + row * row_stride_ + column * column_stride_);
  }
  Eigen::VectorXd row(py::ssize_t row) const;
  /// Shape of a result with one entry per row: what follows is that entry's shape.
  std::vector<py::ssize_t> shapeOf(std::initializer_list<py::ssize_t> entry) const;

  /// Distances between neighbours [bytes].
  py::ssize_t rowStride() const { return row_stride_; }
  py::ssize_t columnStride() const { return column_stride_; }
  const char* data() const { return data_; }

 private:
  py::array array_;  // keeps the numbers alive
  const char* data_;
  bool single_;
  py::ssize_t rows_, columns_, row_stride_, column_stride_;
};

/// The float64 array of an argument, aligned, of any shape. Throws as Rows does.
py::array arrayOf(const py::handle& given, const char* name);

/// @throws ValueError naming the argument and the row of an entry that is NaN or infinite.
void requireFinite(const Rows& rows, const char* name);

/// "(3,)", "(2, 3)".
std::string shapeText(const py::array& array);

/// New array.
py::array_t<double> vectorOf(const Eigen::Ref<const Eigen::VectorXd>& vector);
/// New array (rows, columns), in the order of C.
py::array_t<double> matrixOf(const Eigen::Ref<const Eigen::MatrixXd>& matrix);

}  // namespace helix_arm::python

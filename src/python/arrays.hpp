#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include "helix_arm/lie/se3.hpp"

/// Single values of a caller: what pybind11 would refuse without naming the argument.
namespace helix_arm::python {

namespace py = pybind11;

/// @param name  of the argument, for messages.
/// @throws TypeError if it is no integer (of Python or NumPy), ValueError if it is beyond lower to
///     upper.
std::int64_t integerOf(const py::handle& given, const char* name, std::int64_t lower,
                       std::int64_t upper);
/// @throws TypeError if it is no number.
double numberOf(const py::handle& given, const char* name);
/// @throws TypeError if it is neither True nor False.
bool flagOf(const py::handle& given, const char* name);
/// @throws TypeError if it is no str, ValueError if UTF-8 cannot hold it.
std::string textOf(const py::handle& given, const char* name);

/// Number of threads of an argument: 0 stands for all cores.
std::size_t threadCount(const py::handle& given);

/// Ends a call whose argument is of the wrong type.
[[noreturn]] void refuseType(const py::handle& given, const char* name, const char* expected);

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
  /// How many numbers a result has, of so many per row.
  /// @throws TooManyRows naming the argument if no process can hold them.
  py::ssize_t numbersOf(py::ssize_t per_row) const;
  /// Shape of a result with one entry per row: what follows is that entry's shape.
  /// @throws as numbersOf().
  std::vector<py::ssize_t> shapeOf(const std::vector<py::ssize_t>& entry) const;
  /// Ends a call in which a number broke its rule after all were checked.
  [[noreturn]] void refuseChange() const;

  /// Distances between neighbours [bytes].
  py::ssize_t rowStride() const { return row_stride_; }
  py::ssize_t columnStride() const { return column_stride_; }
  const char* data() const { return data_; }

 private:
  std::string name_;
  py::array array_;  // keeps the numbers alive
  const char* data_;
  bool single_;
  py::ssize_t rows_, columns_, row_stride_, column_stride_;
};

/// The float64 array of an argument, aligned, of any shape. Throws as Rows does.
py::array arrayOf(const py::handle& given, const char* name);

/// @throws ValueError naming the argument and the row of an entry that is NaN or infinite.
void requireFinite(const Rows& rows);

/// New array of these numbers. Those of py::array_t are copied by NumPy, which gives up the
/// interpreter meanwhile: when it ends, a daemon thread is then unwound through its caller.
template <class Number>
py::array_t<Number> copyOf(const Number* first, const std::vector<py::ssize_t>& shape) {
  py::array_t<Number> out(shape);
  std::copy_n(first, out.size(), out.mutable_data());
  return out;
}

/// New array of ASCII text, also of none.
py::array textsOf(const py::list& texts);

/// "(3,)", "(2, 3)".
std::string shapeText(const py::array& array);

/// New array.
py::array_t<double> vectorOf(const Eigen::Ref<const Eigen::VectorXd>& vector);
/// New array (rows, columns), in the order of C.
py::array_t<double> matrixOf(const Eigen::Ref<const Eigen::MatrixXd>& matrix);

/// Writes a position (3) [m] and a quaternion (4); NaN unless it was found.
void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion);

}  // namespace helix_arm::python

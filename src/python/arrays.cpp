#include "arrays.hpp"

#include <cmath>
#include <sstream>

#include "arguments.hpp"

namespace helix_arm::python {
namespace {

bool isFloat64(const py::array& array) {
  const py::dtype wanted = py::dtype::of<double>();
  return array.dtype().is(wanted) || array.dtype().equal(wanted);
}

}  // namespace

std::string shapeText(const py::array& array) {
  std::ostringstream text;
  text << "(";
  for (py::ssize_t i = 0; i < array.ndim(); ++i) text << (i > 0 ? ", " : "") << array.shape(i);
  text << (array.ndim() == 1 ? ",)" : ")");
  return text.str();
}

py::array arrayOf(const py::handle& given, const char* name) {
  if (py::isinstance<py::array>(given)) {
    auto array = py::reinterpret_borrow<py::array>(given);
    if (!isFloat64(array)) {
      throw py::type_error(std::string(name) + " has dtype " + std::string(py::str(array.dtype())) +
                           "; expected float64, as of " + name + ".astype(float)");
    }
    const bool aligned = (array.flags() & py::detail::npy_api::NPY_ARRAY_ALIGNED_) != 0;
    if (!aligned) return py::array_t<double, py::array::c_style | py::array::forcecast>(array);
    return array;
  }
  if (py::isinstance<py::list>(given) || py::isinstance<py::tuple>(given)) {
    // Of text, numpy would parse numbers.
    const py::array any = py::array::ensure(given);
    if (any && (any.dtype().kind() == 'f' || any.dtype().kind() == 'i' || any.size() == 0)) {
      return py::array_t<double, py::array::c_style | py::array::forcecast>(any);
    }
    PyErr_Clear();
    throw py::type_error(std::string(name) +
                         " is a list that is no table of numbers; expected equally long rows of "
                         "floats");
  }
  refuseType(given, name, "a numpy array of float64");
}

Rows::Rows(const py::handle& given, const char* name, py::ssize_t columns)
    : array_(arrayOf(given, name)), columns_(columns) {
  const py::ssize_t dimensions = array_.ndim();
  if (dimensions < 1 || dimensions > 2 || array_.shape(dimensions - 1) != columns) {
    std::ostringstream message;
    message << name << " has shape " << shapeText(array_) << "; expected (" << columns
            << ",) or (N, " << columns << ")";
    throw py::value_error(message.str());
  }
  single_ = dimensions == 1;
  data_ = static_cast<const char*>(array_.data());
  rows_ = single_ ? 1 : array_.shape(0);
  row_stride_ = single_ ? 0 : array_.strides(0);
  column_stride_ = array_.strides(dimensions - 1);
}

Eigen::VectorXd Rows::row(py::ssize_t row) const {
  Eigen::VectorXd out(columns_);
  for (py::ssize_t j = 0; j < columns_; ++j) out[j] = (*this)(row, j);
  return out;
}

std::vector<py::ssize_t> Rows::shapeOf(std::initializer_list<py::ssize_t> entry) const {
  std::vector<py::ssize_t> shape;
  if (!single_) shape.push_back(rows_);
  shape.insert(shape.end(), entry.begin(), entry.end());
  return shape;
}

void requireFinite(const Rows& rows, const char* name) {
  for (py::ssize_t i = 0; i < rows.rows(); ++i) {
    for (py::ssize_t j = 0; j < rows.columns(); ++j) {
      if (std::isfinite(rows(i, j))) continue;
      std::ostringstream message;
      message << name << " holds " << rows(i, j) << " in row " << i << ", column " << j
              << "; expected finite numbers";
      throw py::value_error(message.str());
    }
  }
}

py::array_t<double> vectorOf(const Eigen::Ref<const Eigen::VectorXd>& vector) {
  py::array_t<double> out(vector.size());
  Eigen::VectorXd::Map(out.mutable_data(), vector.size()) = vector;
  return out;
}

py::array_t<double> matrixOf(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  py::array_t<double> out({matrix.rows(), matrix.cols()});
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  RowMajor::Map(out.mutable_data(), matrix.rows(), matrix.cols()) = matrix;
  return out;
}

}  // namespace helix_arm::python

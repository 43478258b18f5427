#include "arrays.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <sstream>

#include "helix_arm/lie/so3.hpp"

namespace helix_arm::python {
namespace {

constexpr py::ssize_t kMostBytes = py::ssize_t{1} << 47;

}  // namespace

py::array argumentArray(const py::handle& given, const char* name) {
  if (py::isinstance<py::array>(given)) {
    auto array = py::reinterpret_borrow<py::array>(given);
    const py::dtype wanted = py::dtype::of<double>();
    if (!array.dtype().is(wanted) && !array.dtype().equal(wanted)) {
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
    throw py::type_error(
        std::string(name) +
        " is a list that is no table of numbers; expected equally long rows of floats");
  }
  throw py::type_error(std::string(name) + " is of type " +
                       std::string(py::str(py::type::of(given).attr("__name__"))) +
                       "; expected a numpy array of float64");
}

Rows::Rows(const py::handle& given, const char* name, py::ssize_t columns)
    : name_(name), array_(argumentArray(given, name)), columns_(columns) {
  const py::ssize_t dimensions = array_.ndim();
  if (dimensions < 1 || dimensions > 2 || array_.shape(dimensions - 1) != columns) {
    throw py::value_error(name_ + " has shape " + std::string(py::str(array_.attr("shape"))) +
                          "; expected (" + std::to_string(columns) + ",) or (N, " +
                          std::to_string(columns) + ")");
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

std::vector<py::ssize_t> Rows::shapeOf(const std::vector<py::ssize_t>& entry) const {
  py::ssize_t most = kMostBytes / static_cast<py::ssize_t>(sizeof(double));
  for (const py::ssize_t size : entry) most /= size;
  if (rows_ > most) {
    throw TooManyRows(name_ + " has " + std::to_string(rows_) +
                      " rows, whose results take more than the 128 TiB that a process can address; "
                      "expected at most " +
                      std::to_string(most) + ", and no more than the memory holds");
  }
  std::vector<py::ssize_t> shape;
  if (!single_) shape.push_back(rows_);
  shape.insert(shape.end(), entry.begin(), entry.end());
  return shape;
}

void Rows::refuseChange() const {
  throw py::value_error(
      name_ +
      " changed during the call; expected an array that no thread writes until the call returns");
}

void Rows::requireFinite() const {
  for (py::ssize_t i = 0; i < rows_; ++i) {
    for (py::ssize_t j = 0; j < columns_; ++j) {
      const double number = (*this)(i, j);
      if (std::isfinite(number)) continue;
      std::ostringstream message;
      message << name_ << " holds " << number << " in row " << i << ", column " << j
              << "; expected finite numbers";
      throw py::value_error(message.str());
    }
  }
}

void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion) {
  constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
  Eigen::Vector3d::Map(position) = found ? pose.translation : Eigen::Vector3d::Constant(kNoNumber);
  Eigen::Vector4d::Map(quaternion) =
      found ? lie::quaternionXyzw(pose.rotation) : Eigen::Vector4d::Constant(kNoNumber);
}

}  // namespace helix_arm::python

#include "arrays.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <thread>

#include "helix_arm/basics/requirement.hpp"
#include "helix_arm/lie/so3.hpp"

namespace helix_arm::python {
namespace {

constexpr int kMostThreads = 1024;

// What Python's conversion said names no argument.
py::object forget(PyObject* converted) {
  if (converted == nullptr) PyErr_Clear();
  return py::reinterpret_steal<py::object>(converted);
}

constexpr py::ssize_t kMostBytes = py::ssize_t{1} << 47;

bool isFloat64(const py::array& array) {
  const py::dtype wanted = py::dtype::of<double>();
  return array.dtype().is(wanted) || array.dtype().equal(wanted);
}

}  // namespace

void refuseType(const py::handle& given, const char* name, const char* expected) {
  throw py::type_error(std::string(name) + " is of type " +
                       std::string(py::str(py::type::of(given).attr("__name__"))) + "; expected " +
                       expected);
}

std::int64_t integerOf(const py::handle& given, const char* name, std::int64_t lower,
                       std::int64_t upper) {
  const bool flag = PyBool_Check(given.ptr()) != 0;
  const py::object index = flag ? py::object() : forget(PyNumber_Index(given.ptr()));
  if (!index) refuseType(given, name, "an int");
  int overflow = 0;
  const std::int64_t value = PyLong_AsLongLongAndOverflow(index.ptr(), &overflow);
  if (overflow == 0 && value >= lower && value <= upper) return value;
  const std::string text = overflow != 0 ? "beyond 64 bits" : std::to_string(value);
  throw py::value_error(std::string(name) + " is " + text + "; expected " + std::to_string(lower) +
                        " to " + std::to_string(upper));
}

double numberOf(const py::handle& given, const char* name) {
  const bool text = py::isinstance<py::str>(given) || py::isinstance<py::bytes>(given);
  const py::object number = text ? py::object() : forget(PyNumber_Float(given.ptr()));
  if (!number) refuseType(given, name, "a number");
  return PyFloat_AS_DOUBLE(number.ptr());
}

bool flagOf(const py::handle& given, const char* name) {
  if (!py::isinstance<py::bool_>(given)) refuseType(given, name, "True or False");
  return given.ptr() == Py_True;
}

std::string textOf(const py::handle& given, const char* name) {
  if (!py::isinstance<py::str>(given)) refuseType(given, name, "a str");
  const py::object bytes = forget(PyUnicode_AsUTF8String(given.ptr()));
  if (!bytes) {
    throw py::value_error(std::string(name) + " is " + std::string(py::repr(given)).substr(0, 60) +
                          ", which UTF-8 cannot hold; expected text without surrogates");
  }
  return py::reinterpret_borrow<py::bytes>(bytes);
}

std::size_t threadCount(const py::handle& given) {
  constexpr auto kMost = std::numeric_limits<std::int64_t>::max();
  const std::int64_t threads = integerOf(given, "threads", -kMost, kMost);
  basics::require(threads >= 0 && threads <= kMostThreads, "threads is ", threads,
                  "; expected 1 to ", kMostThreads, ", or 0 for all cores");
  if (threads > 0) return static_cast<std::size_t>(threads);
  return std::max(1u, std::thread::hardware_concurrency());
}

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
    throw py::type_error(
        std::string(name) +
        " is a list that is no table of numbers; expected equally long rows of floats");
  }
  refuseType(given, name, "a numpy array of float64");
}

Rows::Rows(const py::handle& given, const char* name, py::ssize_t columns)
    : name_(name), array_(arrayOf(given, name)), columns_(columns) {
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

py::ssize_t Rows::numbersOf(py::ssize_t per_row) const {
  const py::ssize_t most = kMostBytes / static_cast<py::ssize_t>(sizeof(double)) / per_row;
  if (rows_ > most) {
    throw TooManyRows(name_ + " has " + std::to_string(rows_) +
                      " rows, whose results take more than the 128 TiB that a process can address; "
                      "expected at most " +
                      std::to_string(most) + ", and no more than the memory holds");
  }
  return rows_ * per_row;
}

std::vector<py::ssize_t> Rows::shapeOf(const std::vector<py::ssize_t>& entry) const {
  py::ssize_t per_row = 1;
  for (const py::ssize_t size : entry) per_row *= size;
  numbersOf(per_row);
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

void requireFinite(const Rows& rows) {
  for (py::ssize_t i = 0; i < rows.rows(); ++i) {
    for (py::ssize_t j = 0; j < rows.columns(); ++j) {
      const double number = rows(i, j);
      if (std::isfinite(number)) continue;
      std::ostringstream message;
      message << rows.name() << " holds " << number << " in row " << i << ", column " << j
              << "; expected finite numbers";
      throw py::value_error(message.str());
    }
  }
}

py::array textsOf(const py::list& texts) {
  // Without code of Python, such as an import: where a daemon thread runs it when the interpreter
  // ends, Python unwinds the callers as well.
  std::vector<std::string> words;
  std::size_t width = 1;
  for (const py::handle text : texts) {
    words.push_back(text.cast<std::string>());
    width = std::max(width, words.back().size());
  }
  py::array out(py::dtype("U" + std::to_string(width)), words.size());
  auto* to = static_cast<char32_t*>(out.mutable_data());
  for (const std::string& word : words) {
    std::fill(std::copy(word.begin(), word.end(), to), to + width, U'\0');
    to += width;
  }
  return out;
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

void setPose(const lie::SE3& pose, bool found, double* position, double* quaternion) {
  constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
  Eigen::Vector3d::Map(position) = found ? pose.translation : Eigen::Vector3d::Constant(kNoNumber);
  Eigen::Vector4d::Map(quaternion) =
      found ? lie::quaternionXyzw(pose.rotation) : Eigen::Vector4d::Constant(kNoNumber);
}

}  // namespace helix_arm::python

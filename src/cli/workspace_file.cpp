#include "workspace_file.hpp"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <sstream>

#include "command.hpp"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "its PLY files are little-endian");

namespace helix_arm::cli {
namespace {

constexpr std::size_t kCountWidth = 20;  // digits of the largest count

bool isPly(const std::string& path) {
  const std::string end = std::filesystem::path(path).extension().string();
  if (end != ".ply" && end != ".csv") {
    throw CallerError("--out " + path + " ends neither in .ply nor in .csv; expected one of them");
  }
  return end == ".ply";
}

// A scene name must not end the line of a header.
std::string oneLine(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, ' ');
  return text;
}

void append(float value, std::string& out) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  out.append(bytes, sizeof value);
}

void append(double value, int digits, char end, std::string& out) {
  char text[32];
  out.append(text, static_cast<std::size_t>(
                       std::snprintf(text, sizeof text, "%.*g%c", digits, value, end)));
}

}  // namespace

CloudFile::CloudFile(const std::string& path, const model::Arm& arm, const CloudOrigin& origin)
    : arm_(arm), origin_(origin), ply_(isPly(path)), file_(path) {
  file_.write(ply_ ? plyHeader() : csvHeader());
}

std::string CloudFile::plyHeader() const {
  const std::string count = std::to_string(points_);
  std::ostringstream out;
  // The count is only known at the end; padding keeps the length of the header constant.
  out << "ply\nformat binary_little_endian 1.0\n"
      << "comment tips of arm " << oneLine(origin_.scene) << ", tier " << origin_.tier << ", seed "
      << origin_.seed << "\ncomment x, y, z in m, seen from the arm's base, x along the arm"
      << std::string(kCountWidth - count.size(), ' ') << "\nelement vertex " << count
      << "\nproperty float x\nproperty float y\nproperty float z\n";
  for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
    out << "property float " << statics::kSensitivityNames[k] << "\n";
  }
  out << "end_header\n";
  return out.str();
}

std::string CloudFile::csvHeader() const {
  std::ostringstream out;
  out << "# tips of arm " << oneLine(origin_.scene) << ", tier " << origin_.tier << ", seed "
      << origin_.seed << "\n# x, y, z seen from the arm's base, x along the arm\n";
  if (origin_.sensitivity) {
    out << "# tip displacement for an error of 1 kPa in every pressure, of 1 mm in every free "
           "length, of 1 % in the stiffness\n";
  }
  for (int i = 0; i < arm_.actuatorCount(); ++i) {
    const model::DriveUnit unit = model::unitOf(arm_.actuator(i).drive);
    out << unit.quantity << "_" << i + 1 << "_" << unit.suffix << ",";
  }
  out << "x_m,y_m,z_m";
  for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
    out << "," << statics::kSensitivityNames[k];
  }
  out << "\n";
  return out.str();
}

std::string CloudFile::encode(const statics::WorkspacePoints& points) const {
  return ply_ ? encodePly(points) : encodeCsv(points);
}

std::string CloudFile::encodePly(const statics::WorkspacePoints& points) const {
  std::string out;
  const auto columns = points.tips.cols() + (origin_.sensitivity ? points.sensitivity.cols() : 0);
  out.reserve(static_cast<std::size_t>(points.count() * columns) * sizeof(float));
  for (int row = 0; row < points.count(); ++row) {
    for (int k = 0; k < 3; ++k) append(static_cast<float>(points.tips(row, k)), out);
    for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
      append(static_cast<float>(points.sensitivity(row, k)), out);
    }
  }
  return out;
}

std::string CloudFile::encodeCsv(const statics::WorkspacePoints& points) const {
  constexpr int kInputDigits = 17;  // they read back as the same value
  constexpr int kTipDigits = 12;
  constexpr int kSensitivityDigits = 9;
  std::string out;
  for (int row = 0; row < points.count(); ++row) {
    for (int i = 0; i < arm_.actuatorCount(); ++i) {
      const double scale = model::unitOf(arm_.actuator(i).drive).scale;
      append(points.inputs(row, i) / scale, kInputDigits, ',', out);
    }
    for (int k = 0; k < 3; ++k) {
      append(points.tips(row, k), kTipDigits, k == 2 && !origin_.sensitivity ? '\n' : ',', out);
    }
    for (int k = 0; k < statics::kSensitivities && origin_.sensitivity; ++k) {
      append(points.sensitivity(row, k), kSensitivityDigits,
             k + 1 == statics::kSensitivities ? '\n' : ',', out);
    }
  }
  return out;
}

void CloudFile::write(const std::string& encoded, std::uint64_t points) {
  file_.write(encoded);
  points_ += points;
}

void CloudFile::finish() {
  if (ply_) file_.writeOver(0, plyHeader());
  file_.commit();
}

}  // namespace helix_arm::cli

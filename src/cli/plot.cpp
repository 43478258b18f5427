#include "plot.hpp"

#include <filesystem>

#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/report_plot.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;

// Whether both paths name the same file, existing or not.
bool samePlace(const std::string& one, const std::string& other) {
  std::error_code error;
  if (fs::equivalent(one, other, error)) return true;
  return fs::weakly_canonical(fs::absolute(one)) == fs::weakly_canonical(fs::absolute(other));
}

}  // namespace

void drawJsonReport(const nlohmann::json& report, const std::string& picture,
                    const std::string& without) {
  procedures::drawReportText(report.dump(), picture, without);
}

void checkPicture(const std::string& png, const std::string& out) {
  if (png.empty()) return;
  if (!out.empty() && samePlace(out, png)) {
    throw CallerError("--png " + png + " is the file of --out, too; give another path");
  }
  const io::AtomicFile trial(png);  // throws if none can be written there; leaves no file
}

}  // namespace helix_arm::cli

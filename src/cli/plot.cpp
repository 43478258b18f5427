#include "plot.hpp"

#include <filesystem>

#include "command.hpp"
#include "helix_arm/io/atomic_file.hpp"
#include "helix_arm/procedures/report_plot.hpp"

namespace helix_arm::cli {
namespace {

namespace fs = std::filesystem;

// Whether both name one file, there or not.
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
    throw CallerError("--png " + png + " is the file of --out; name another one");
  }
  const io::AtomicFile trial(png);  // throws where none can be written; leaves nothing
}

}  // namespace helix_arm::cli

#pragma once

#include <string>

#include "nlohmann/json.hpp"

namespace helix_arm::cli {

/// Has plot_report draw a report as a picture: see procedures::drawReportText().
void drawJsonReport(const nlohmann::json& report, const std::string& picture,
                    const std::string& without);

/// Checks the file of --png, which may be empty, before work that takes long.
/// @param out  the file of --out, may be empty.
/// @throws CallerError if both are the same file, io::FileError if the picture cannot be written.
void checkPicture(const std::string& png, const std::string& out);

}  // namespace helix_arm::cli

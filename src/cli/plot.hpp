#pragma once

#include <filesystem>
#include <string>

namespace helix_arm::cli {

/// Has plot_report draw a report as a picture.
///
/// @param without  what the user may do to go without the picture: "leave it out with --no-files".
/// @throws CallerError naming the picture and the remedy.
void drawReport(const std::filesystem::path& report, const std::filesystem::path& picture,
                const std::string& without);

}  // namespace helix_arm::cli

#pragma once

#include <filesystem>
#include <string>

#include "nlohmann/json.hpp"

namespace helix_arm::cli {

/// Has plot_report draw a report as a picture.
///
/// @param without  what the user may do to go without the picture: "leave it out with --no-files".
/// @throws CallerError naming the picture and the remedy.
void drawReport(const std::filesystem::path& report, const std::filesystem::path& picture,
                const std::string& without);
/// The same of a report that is in no file.
void drawJsonReport(const nlohmann::json& report, const std::string& picture,
                    const std::string& without);

/// Checks the file of --png, which may be empty, before work that takes long.
/// @param out  the file of --out, may be empty.
/// @throws CallerError if both are the same file, io::FileError if the picture cannot be written.
void checkPicture(const std::string& png, const std::string& out);

}  // namespace helix_arm::cli

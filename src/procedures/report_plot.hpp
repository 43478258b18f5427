#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace helix_arm::procedures {

/// A file that a report names, in its folder.
struct ReportPart {
  std::string name, content;
};

/// Where a script is: beside the program where it is installed, else among the package's files.
std::filesystem::path scriptPath(const std::string& script);

/// Runs a script of the package on a report: a JSON document.
///
/// @param arguments  behind the report's file.
/// @param failure    message where the script fails.
/// @param beside     without a name: none.
/// @return what the script printed.
/// @throws std::invalid_argument with the script's reason to refuse the report, io::FileError
/// where it fails.
std::string runScript(const std::string& script, const std::string& report,
                      const std::vector<std::string>& arguments, const std::string& failure,
                      const ReportPart& beside = {});

/// Has plot_report draw a report as a picture, or print it as pages.
///
/// @param without  what the user may do to go without the picture: "leave it out with --no-files".
/// @return what plot_report printed.
/// @throws as runScript(), naming the picture and the remedy.
std::string drawReport(const std::string& report, const std::filesystem::path& picture,
                       const std::string& without, const ReportPart& beside = {});

}  // namespace helix_arm::procedures

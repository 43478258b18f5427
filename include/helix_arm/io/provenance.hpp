#pragma once

#include <optional>
#include <string>
#include <vector>

namespace helix_arm::io {

/// Where a calibrated scene comes from and how far to trust it: the key `calibration` of a scene.
/// Nothing of it enters the model.
struct Provenance {
  /// What the calibration was made from.
  struct Data {
    std::string file;    ///< as it was named then
    std::string sha256;  ///< of its content, 64 hexadecimal digits
    int captures;        ///< that it holds, >= 0
  };
  /// One calibrated number, in the unit that its name goes with.
  struct Parameter {
    std::string name;  ///< a word, unlike the others'
    double value;
    double standard_error;  ///< >= 0
    bool identifiable;      ///< the data said more of it than was known
    std::string unit;       ///< may be empty
  };

  std::string date;             ///< of the calibration, UTC: 2026-01-31T12:00:00Z
  std::string package_version;  ///< that made it
  std::string from;             ///< path of the scene it began with
  std::string from_sha256;      ///< of its content; may be empty
  std::string overrides;        ///< of its keys: `key=value`, joined by blanks; may be empty
  std::vector<Data> data;       ///< at least one; those of other arms as well
  std::vector<Parameter> parameters;
  double rms;                            ///< of the residuals that fit, >= 0
  std::optional<double> held_out_error;  ///< of what was left out of the fit, >= 0
  std::string error_unit;                ///< of both: rad, px or m
};

}  // namespace helix_arm::io

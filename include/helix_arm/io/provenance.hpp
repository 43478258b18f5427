#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "helix_arm/calibration/calibration_parameters.hpp"
#include "helix_arm/lie/se3.hpp"

namespace helix_arm::io {

/// Origin and quality of a calibrated scene: its key `calibration`. It does not affect the model.
struct Provenance {
  /// One source of the calibration.
  struct Data {
    std::string file;    ///< path as given to the calibration
    std::string sha256;  ///< of its content, 64 hexadecimal digits
    int captures;        ///< number of captures, >= 0
  };
  /// One calibrated number, in the unit of its name.
  struct Parameter {
    std::string name;  ///< unique word
    double value;
    double standard_error;  ///< >= 0
    bool identifiable;      ///< the data determined it better than the prior
    std::string unit;       ///< may be empty
  };
  /// Product of powers of parameters whose error is not correlated with that of the others.
  struct Combination {
    std::map<std::string, double> exponents;  ///< of at least two parameters
    double relative_error;                    ///< > 0
    bool identifiable;                        ///< as of a parameter
  };

  std::string date;             ///< of the calibration, UTC: 2026-01-31T12:00:00Z
  std::string package_version;  ///< that made it
  std::string from;             ///< path of the initial scene
  std::string from_sha256;      ///< of its content; may be empty
  std::string overrides;  ///< overrides of its keys: `key=value`, separated by blanks; may be empty
  std::vector<Data> data;  ///< at least one; includes those of other arms
  std::vector<Parameter> parameters;
  /// As many as parameters in them; their exponents are orthogonal unit vectors.
  std::vector<Combination> combinations;
  double rms;                            ///< RMS of the inlier residuals, >= 0
  std::optional<double> held_out_error;  ///< error on held-out data, >= 0
  std::string error_unit;                ///< unit of both: rad, px, m or N

  /// How well a placement is known that was fitted.
  struct PlacementError {
    lie::Vector6 deviations;  ///< standard errors, in the order of its numbers [m, rad]
    bool seen;                ///< the data determined a number of it better than the prior
  };
  /// @param placement  kBase or kTags. @param of  "_<id>" of a tag, empty for the base.
  /// @return nothing if it was not fitted.
  std::optional<PlacementError> errorOf(estimation::FitParameter placement,
                                        const std::string& of) const;
};

}  // namespace helix_arm::io

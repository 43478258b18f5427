# What the layers above the core need.
find_package(OpenSSL REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(CLI11 QUIET)
if(HELIX_ARM_ROS AND NOT CLI11_FOUND)  # Ubuntu 20.04 has no package of it
  include(FetchContent)
  FetchContent_Declare(CLI11 GIT_REPOSITORY https://github.com/CLIUtils/CLI11.git GIT_TAG v2.1.2 GIT_SHALLOW TRUE)
  FetchContent_GetProperties(CLI11)
  if(NOT cli11_POPULATED)
    FetchContent_Populate(CLI11)
  endif()
  add_library(CLI11::CLI11 INTERFACE IMPORTED)  # headers alone
  target_include_directories(CLI11::CLI11 SYSTEM INTERFACE ${cli11_SOURCE_DIR}/include)
endif()
set(helix_arm_markers objdetect)
find_package(OpenCV REQUIRED COMPONENTS calib3d core imgproc imgcodecs objdetect videoio)
if(OpenCV_VERSION VERSION_LESS 4.7)  # they are in a contributed module
  set(helix_arm_markers aruco)
  find_package(OpenCV REQUIRED COMPONENTS aruco)
endif()
find_package(fcl 0.6 REQUIRED)
if(HELIX_ARM_ROS)
  find_package(ompl REQUIRED)
  find_library(helix_arm_ompl ompl HINTS ${OMPL_LIBRARY_DIRS} REQUIRED)  # OMPL_LIBRARIES names more, which is not needed
endif()
find_package(Python3 REQUIRED COMPONENTS Interpreter Development)  # before pybind11, which takes what it finds
find_package(pybind11 2.4 REQUIRED)
find_package(Threads REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(apriltag REQUIRED IMPORTED_TARGET apriltag)
pkg_check_modules(modbus REQUIRED IMPORTED_TARGET libmodbus)
pkg_check_modules(turbojpeg REQUIRED IMPORTED_TARGET libturbojpeg)

# What pip installs: the folder helix_arm of the wheel is a prefix of its own, whose libraries and scenes lie where those of a
# package lie in theirs (io::shippedFolder). setup.py configures it.
set_target_properties(helix_arm_python PROPERTIES INSTALL_RPATH "$ORIGIN/lib")
install(TARGETS helix_arm_core helix_arm_clearance helix_arm_estimation helix_arm_follow helix_arm_devices helix_arm_media helix_arm_io
    helix_arm_procedures helix_arm_bag
  LIBRARY DESTINATION lib)
install(TARGETS helix_arm_python LIBRARY DESTINATION .)
install(DIRECTORY python/helix_arm/ DESTINATION . PATTERN __pycache__ EXCLUDE)
install(DIRECTORY config DESTINATION share/helix_arm)
install(PROGRAMS scripts/read_bag DESTINATION share/helix_arm/scripts)

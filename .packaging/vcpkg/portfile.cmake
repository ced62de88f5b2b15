# An overlay port that builds the tree which it is in.
set(SOURCE_PATH "${CMAKE_CURRENT_LIST_DIR}/../..")

vcpkg_check_features(
  OUT_FEATURE_OPTIONS FEATURE_OPTIONS
  FEATURES
    ceres ASTERISM_WITH_CERES
    cholmod ASTERISM_WITH_CHOLMOD
    json ASTERISM_WITH_JSON
    lbfgs ASTERISM_WITH_LIBLBFGS
    parts ASTERISM_WITH_PARTS
    trackers ASTERISM_WITH_TRACKERS)

vcpkg_cmake_configure(
  SOURCE_PATH "${SOURCE_PATH}"
  OPTIONS ${FEATURE_OPTIONS} -DASTERISM_INSTALL=ON -DASTERISM_BUILD_TOOLS=OFF -DASTERISM_BUILD_PYTHON=OFF
          -DASTERISM_BUILD_DOCS=OFF -DASTERISM_BUILD_TESTS=OFF -DASTERISM_BUILD_BENCH=OFF)
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(PACKAGE_NAME Asterism CONFIG_PATH lib/cmake/Asterism)
vcpkg_fixup_pkgconfig()
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/debug/include" "${CURRENT_PACKAGES_DIR}/debug/share"
     "${CURRENT_PACKAGES_DIR}/share/doc")
vcpkg_install_copyright(FILE_LIST "${SOURCE_PATH}/LICENSE")
file(INSTALL "${CMAKE_CURRENT_LIST_DIR}/usage" DESTINATION "${CURRENT_PACKAGES_DIR}/share/${PORT}")

# The Debian packages that cpack makes of the install rules: libasterism-dev (headers, CMake and pkg-config files, static
# libraries), asterism-tools and, where BUILD_SHARED_LIBS, libasterism0.1.

# What users of each component need beside libasterism-dev.
set(asterism_debian_solver libeigen3-dev)
set(asterism_debian_cholmod libsuitesparse-dev)
set(asterism_debian_ceres libceres-dev)
set(asterism_debian_lbfgs liblbfgs-dev)
set(asterism_debian_json nlohmann-json3-dev)
set(asterism_debian_parts libopencv-dev)

# asterism_debian_package(COMPONENT NAME SECTION SYNOPSIS TEXT): in the caller's scope, what CPack wants to know.
macro(asterism_debian_package component name section synopsis text)
  list(APPEND CPACK_COMPONENTS_ALL Asterism_${component})
  string(TOUPPER ASTERISM_${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${name})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${section})
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${synopsis}\n${text}")
  install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${name} RENAME copyright COMPONENT Asterism_${component})
endmacro()

# A function, for CPack's variables to stay in it.
function(asterism_debian_packages)
  set(CPACK_GENERATOR DEB)
  set(CPACK_PACKAGE_NAME asterism)
  set(CPACK_PACKAGE_CONTACT "The Asterism developers")
  set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
  set(CPACK_STRIP_FILES ON)
  set(CPACK_DEB_COMPONENT_INSTALL ON)
  set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
  set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
  set(same_version "(= ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})")
  set(runtime libasterism${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  set(text "Asterism finds the most probable placement of a constellation of parts, and tracks deformable objects in video \
with it.")

  get_property(components GLOBAL PROPERTY ASTERISM_COMPONENTS)
  get_property(tools GLOBAL PROPERTY ASTERISM_TOOLS)
  set(CPACK_COMPONENTS_ALL "")
  asterism_debian_package(dev libasterism-dev libdevel "deformable-parts constellations and trackers - development files"
                          "${text}\nThis package holds the headers, and the files of CMake and pkg-config.")
  set(suggested "")
  foreach(component IN LISTS components)
    list(APPEND suggested ${asterism_debian_${component}})
  endforeach()
  list(REMOVE_ITEM suggested libeigen3-dev)
  list(JOIN suggested ", " CPACK_DEBIAN_ASTERISM_DEV_PACKAGE_SUGGESTS)
  set(CPACK_DEBIAN_ASTERISM_DEV_PACKAGE_DEPENDS libeigen3-dev)
  if(BUILD_SHARED_LIBS)
    asterism_debian_package(runtime ${runtime} libs "deformable-parts constellations and trackers - shared libraries"
                            "${text}")
    set(CPACK_DEBIAN_ASTERISM_RUNTIME_PACKAGE_SHLIBDEPS ON)
    set(CPACK_DEBIAN_ASTERISM_RUNTIME_PACKAGE_GENERATE_SHLIBS ON)
    string(APPEND CPACK_DEBIAN_ASTERISM_DEV_PACKAGE_DEPENDS ", ${runtime} ${same_version}")
    set(CPACK_DEBIAN_ASTERISM_TOOLS_PACKAGE_DEPENDS "${runtime} ${same_version}")
    # Where dpkg-shlibdeps finds the libraries of other packages that are being made.
    foreach(room IN ITEMS solver parts trackers)
      list(APPEND CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${PROJECT_BINARY_DIR}/${room})
    endforeach()
  endif()
  if(tools)
    asterism_debian_package(tools asterism-tools video "deformable-parts constellations and trackers - programs"
                            "${text}\nThis package holds its programs.")
    set(CPACK_DEBIAN_ASTERISM_TOOLS_PACKAGE_SHLIBDEPS ON)
  endif()
  include(CPack)
endfunction()

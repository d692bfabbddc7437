# Debian packages, one for each install component; tools/package runs CPack.
set(BOLO_DEBIAN_REVISION 1 CACHE STRING "What stands behind the version of the Debian packages")

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME bolo)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "The authors of Bolo <bolo@bolo.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_SOURCE_DIR}/build/package)
if(CMAKE_CROSSCOMPILING)
  string(APPEND CPACK_PACKAGE_DIRECTORY -${CPACK_DEBIAN_PACKAGE_ARCHITECTURE})
endif()
set(CPACK_SET_DESTDIR ON)  # configuration goes to /etc, outside the prefix
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE ${BOLO_DEBIAN_REVISION})
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_PACKAGE_PRIORITY optional)

set(packaging ${PROJECT_SOURCE_DIR}/cmake/packaging)
set(packaging_made ${PROJECT_BINARY_DIR}/packaging)

# Required by Debian in /usr/share/doc of every package: the copyright, and both changelogs, compressed.
configure_file(${packaging}/changelog.in ${packaging_made}/changelog.Debian @ONLY)
configure_file(${PROJECT_SOURCE_DIR}/CHANGELOG.md ${packaging_made}/changelog COPYONLY)
execute_process(COMMAND gzip --force --keep --best --no-name changelog changelog.Debian
  WORKING_DIRECTORY ${packaging_made} COMMAND_ERROR_IS_FATAL ANY)

# Package that programs linking with the library depend on, for dpkg-shlibdeps.
configure_file(${packaging}/libbolo-client/shlibs.in ${packaging_made}/shlibs @ONLY)

# bolo_package(NAME SECTION section SUMMARY line TEXT line... [ARCHITECTURE all] [DEPENDS package...]
#              [RECOMMENDS package...] [SUGGESTS package...] [CONTROL file...])
# Package NAME from the component NAME, if something is installed into it. Dependencies on libraries are found
# automatically. CONTROL: maintainer scripts and lists for dpkg.
get_cmake_property(installed COMPONENTS)
macro(bolo_package name)
  if(${name} IN_LIST installed)
    cmake_parse_arguments(arg "" "SECTION;SUMMARY;ARCHITECTURE" "TEXT;DEPENDS;RECOMMENDS;SUGGESTS;CONTROL" ${ARGN})
    foreach(list DEPENDS RECOMMENDS SUGGESTS)
      list(JOIN arg_${list} ", " arg_${list})
    endforeach()
    list(JOIN arg_TEXT "\n" arg_TEXT)
    string(TOUPPER ${name} key)
    set(CPACK_DEBIAN_${key}_PACKAGE_NAME ${name})
    set(CPACK_DEBIAN_${key}_PACKAGE_SECTION ${arg_SECTION})
    set(CPACK_DEBIAN_${key}_DESCRIPTION "${arg_SUMMARY}\n${arg_TEXT}")
    set(CPACK_DEBIAN_${key}_PACKAGE_ARCHITECTURE ${arg_ARCHITECTURE})
    set(CPACK_DEBIAN_${key}_PACKAGE_DEPENDS "${arg_DEPENDS}")
    set(CPACK_DEBIAN_${key}_PACKAGE_RECOMMENDS "${arg_RECOMMENDS}")
    set(CPACK_DEBIAN_${key}_PACKAGE_SUGGESTS "${arg_SUGGESTS}")
    set(CPACK_DEBIAN_${key}_PACKAGE_CONTROL_EXTRA ${arg_CONTROL})
    list(APPEND CPACK_COMPONENTS_ALL ${name})
    install(FILES ${packaging}/copyright ${packaging_made}/changelog.gz ${packaging_made}/changelog.Debian.gz
      DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/${name} COMPONENT ${name})
  endif()
endmacro()

set(this_version "(= ${PROJECT_VERSION}-${BOLO_DEBIAN_REVISION})")

bolo_package(bolo
  SECTION video
  SUMMARY "sharp frames from moving thermal cameras"
  TEXT "Bolo takes frames from an uncooled microbolometer camera over GigE Vision,"
       "undoes the thermal inertia of every pixel, and hands sharp frames to other"
       "programs, live, through shared memory."
       "."
       "This package has the daemon bolod with its systemd units, and bolo: simulate,"
       "record, replay, convert, calibrate and diagnose."
  DEPENDS "systemd | systemd-standalone-sysusers"
  SUGGESTS v4l2loopback-dkms ffmpeg libimage-exiftool-perl python3-bolo
  CONTROL ${packaging}/bolo/postinst ${packaging}/bolo/prerm ${packaging}/bolo/postrm ${packaging}/bolo/conffiles)

bolo_package(libbolo-client
  SECTION libs
  SUMMARY "frames of a thermal camera from bolod (library)"
  TEXT "Reads the frames that bolod, the daemon of the package bolo, publishes in"
       "shared memory: without copies, by any number of readers, none of which can"
       "stop it."
  SUGGESTS bolo
  CONTROL ${packaging}/libbolo-client/triggers ${packaging_made}/shlibs)

bolo_package(libbolo-client-dev
  SECTION libdevel
  SUMMARY "frames of a thermal camera from bolod (development files)"
  TEXT "Header, pkg-config file and CMake package of libbolo-client, and the layout of"
       "the shared memory that it reads."
  DEPENDS "libbolo-client ${this_version}")

bolo_package(python3-bolo
  SECTION python
  SUMMARY "frames of a thermal camera from bolod (Python 3)"
  TEXT "A module that shows the frames that bolod publishes in shared memory as NumPy"
       "arrays, without copies."
  ARCHITECTURE all
  DEPENDS python3 python3-numpy "libbolo-client (>= ${PROJECT_VERSION})")

bolo_package(gstreamer1.0-bolo
  SECTION video
  SUMMARY "sharp frames from moving thermal cameras (GStreamer plugin)"
  TEXT "The elements bolosrc, a live source of the frames that bolod publishes, and"
       "bolodeblur, which undoes the thermal inertia of a microbolometer's pixels in"
       "any stream of 16-bit grey, without the daemon."
  SUGGESTS bolo)

bolo_package(bolo-ros2
  SECTION video
  SUMMARY "sharp frames from moving thermal cameras (ROS 2 topics)"
  TEXT "With [ros2] enable = true in its configuration, bolod publishes its frames as"
       "topics of ROS 2, by Cyclone DDS: sensor_msgs/Image, raw and sharp, and"
       "sensor_msgs/CameraInfo. No ROS 2 is needed on the camera's computer."
  DEPENDS "bolo ${this_version}")

include(CPack)

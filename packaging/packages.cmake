# The Debian packages that CPack makes (docs/packages.md): each holds a component of install(). Called by `cpack` in a
# build tree, or by `cmake --workflow --preset package`.

set(SURFEL_MAINTAINER "Surfelkit authors <authors@surfelkit.example>" CACHE STRING "Whom the packages name for questions")
mark_as_advanced(SURFEL_MAINTAINER)

# One time stands in all files, so that the same sources give the same bytes: that of the last change that was noted.
set(epoch "$ENV{SOURCE_DATE_EPOCH}")
if(NOT epoch)
  execute_process(COMMAND git log -1 --format=%ct -- CHANGELOG.md WORKING_DIRECTORY ${PROJECT_SOURCE_DIR}
                  OUTPUT_VARIABLE epoch OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
if(NOT epoch)
  file(TIMESTAMP ${PROJECT_SOURCE_DIR}/CHANGELOG.md epoch %s UTC)
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_PRE_BUILD_SCRIPTS ${CMAKE_CURRENT_LIST_DIR}/stage.cmake)
# Read by cpack. Without the project's own summary the packages have theirs.
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_BINARY_DIR}/packages.cmake)
file(WRITE ${CPACK_PROJECT_CONFIG_FILE} "set(ENV{SOURCE_DATE_EPOCH} ${epoch})\nunset(CPACK_PACKAGE_DESCRIPTION_SUMMARY)\n")

cmake_host_system_information(RESULT system QUERY DISTRIB_ID DISTRIB_VERSION_ID DISTRIB_VERSION_CODENAME)
list(POP_BACK system codename)
list(JOIN system "" system)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1~${system})
set(CPACK_DEBIAN_PACKAGE_MAINTAINER ${SURFEL_MAINTAINER})
set(CPACK_DEBIAN_PACKAGE_SOURCE surfelkit)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_ENABLE_COMPONENT_DEPENDS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${CMAKE_LIBRARY_OUTPUT_DIRECTORY})

set(debian_version ${PROJECT_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})
set(ENV{SOURCE_DATE_EPOCH} ${epoch})
string(TIMESTAMP date "%a, %d %b %Y %H:%M:%S +0000" UTC)
configure_file(${CMAKE_CURRENT_LIST_DIR}/changelog.in ${PROJECT_BINARY_DIR}/changelog.Debian @ONLY)

# surfel_package(COMPONENT NAME SECTION SUMMARY DESCRIPTION [COMPONENTS ...] [DEPENDS|RECOMMENDS|SUGGESTS ...]): the package
# NAME holds COMPONENT. It depends on the packages of COMPONENTS in its own version, on the libraries that its files
# link, and on DEPENDS.
function(surfel_package component name section summary description)
  cmake_parse_arguments(ARG "" "" "COMPONENTS;DEPENDS;RECOMMENDS;SUGGESTS" ${ARGN})
  string(TOUPPER ${component} id)
  set(CPACK_COMPONENTS_ALL ${CPACK_COMPONENTS_ALL} ${component} PARENT_SCOPE)
  set(CPACK_COMPONENT_${id}_DEPENDS ${ARG_COMPONENTS} PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_NAME ${name} PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_PACKAGE_SECTION ${section} PARENT_SCOPE)
  set(CPACK_DEBIAN_${id}_DESCRIPTION "${summary}
Surfelkit turns meshes, scans, volumes and point clouds into surfels, which are
oriented points with Gaussians, and draws them by EWA surface splatting from
the command line, without a GPU.

${description}" PARENT_SCOPE)
  foreach(relation DEPENDS RECOMMENDS SUGGESTS)
    list(JOIN ARG_${relation} ", " packages)
    set(CPACK_DEBIAN_${id}_PACKAGE_${relation} "${packages}" PARENT_SCOPE)
  endforeach()
  install(FILES ${PROJECT_SOURCE_DIR}/packaging/copyright ${PROJECT_BINARY_DIR}/changelog.Debian
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${name} COMPONENT ${component} EXCLUDE_FROM_ALL)
endfunction()

set(library libsurfel${PROJECT_VERSION_MAJOR})
surfel_package(library ${library} libs "surfel splatting, the shared library"
"This package holds the library, with all that needs few other libraries: PNG
pictures, point clouds, meshes, rendering.")
# CPack would write the same shlibs, and warn of every plug-in, which has no version. The trigger stands for CPack's own
# postinst and postrm, which it leaves out where it is told of others, even if there are none.
file(WRITE ${PROJECT_BINARY_DIR}/shlibs "libsurfel ${PROJECT_VERSION_MAJOR} ${library} (= ${debian_version})\n")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA
    ${PROJECT_BINARY_DIR}/shlibs ${CMAKE_CURRENT_LIST_DIR}/triggers postinst postrm)

surfel_package(development libsurfel-dev libdevel "surfel splatting, files for development"
"This package holds the headers of the library, and what CMake and pkg-config
find it by."
COMPONENTS library DEPENDS libeigen3-dev SUGGESTS surfelkit-doc)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SHLIBDEPS OFF)

set(about_exr "EXR pictures, by OpenEXR")
set(about_image "pictures in formats other than PNG and EXR, by OpenImageIO")
set(about_pcd "compressed PCD files, by PCL")
set(about_gltf "compressed glTF files, by Draco and meshoptimizer")
set(about_flann "searches for neighbours by FLANN")
set(about_filters "filters for scans, by PCL")
set(about_ceres "nonlinear solvers, by Ceres")
set(about_icp "registration of scans, by PCL")
set(about_trace "rays onto meshes, by Embree")
set(about_openmesh "topology of meshes, by OpenMesh")
set(about_mpi "pictures by several processes, by MPI")
foreach(plugin IN LISTS SURFEL_PLUGINS)
  surfel_package(plugin-${plugin} ${library}-plugin-${plugin} libs "surfel splatting, ${about_${plugin}}"
"This package holds a plug-in that the library loads when it is first needed:
${about_${plugin}}."
  COMPONENTS library)
  list(APPEND plugin_packages ${library}-plugin-${plugin})
endforeach()

surfel_package(tools surfelkit graphics "surfel splatting, the tools"
"This package holds the tools with their manual pages and completions, and
samples of configurations. What they do by heavy libraries is in packages of
plug-ins, which they name where one is missing."
COMPONENTS library RECOMMENDS ${plugin_packages} surfelkit-view gnuplot-nox SUGGESTS ffmpeg surfelkit-doc)

surfel_package(view surfelkit-view graphics "surfel splatting, pages for browsers"
"This package holds surfel-view, which makes pages that show surfels in a
browser, and serves those of clouds with levels of detail."
COMPONENTS library)

install(FILES README.md CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT documents EXCLUDE_FROM_ALL)
install(DIRECTORY docs examples samples configs DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT documents EXCLUDE_FROM_ALL
        PATTERN demo.sh EXCLUDE PATTERN reproduce.sh EXCLUDE)
# Pages of the site, where it was built, stand beside the documents that they are made of, and show the same pictures. Debian
# has one copy of a licence.
install(DIRECTORY ${PROJECT_BINARY_DIR}/site/ DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT documents EXCLUDE_FROM_ALL OPTIONAL
        PATTERN LICENSE EXCLUDE)
file(CREATE_LINK ../surfelkit-doc/copyright ${PROJECT_BINARY_DIR}/LICENSE SYMBOLIC)
install(FILES ${PROJECT_BINARY_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT documents EXCLUDE_FROM_ALL)
surfel_package(documents surfelkit-doc doc "surfel splatting, documents"
"This package holds the pages about the tools and the library, for browsers and
as texts, programs that use it, and the samples that the commands of the pages
work on.")
set(CPACK_DEBIAN_DOCUMENTS_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_DOCUMENTS_PACKAGE_SHLIBDEPS OFF)

if(SURFEL_BUILD_PYTHON)
  find_package(Python3 REQUIRED COMPONENTS Interpreter)
  math(EXPR next_minor "${Python3_VERSION_MINOR} + 1")
  surfel_package(python python3-surfelkit python "surfel splatting, the Python module"
"This package holds the module surfelkit, which reads, estimates, samples,
textures, draws and compares, with NumPy arrays in and out."
  COMPONENTS library
  DEPENDS "python3 (>= ${Python3_VERSION_MAJOR}.${Python3_VERSION_MINOR})"
          "python3 (<< ${Python3_VERSION_MAJOR}.${next_minor})" python3-numpy)
endif()

include(CPack)

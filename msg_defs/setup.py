"""Build the messages in the current folder with pip alone, from what is in the ROS wheels.

The rosidl pipeline, as rosidl_generate_interfaces() runs it under CMake:

    *.msg, *.srv -> *.idl -> type hashes -> C structs, CDR and introspection type supports, Python classes

which becomes three shared objects inside the Python package: one library per type support that
rmw_fastrtps asks for (it needs both) and the extension module that Python imports. The type support
dispatcher opens the two libraries by their SONAME; linking the module to both has them loaded by then.

package.xml names the package and those it depends on. foreign/ holds packages of others that are not on PyPI.

A colcon workspace never runs this file: package.xml names ament_cmake, so CMakeLists.txt is used.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import os
import shutil
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

SOURCE = Path.cwd()  # builders run a setup.py in its folder
ABOUT = ElementTree.parse(SOURCE / "package.xml").getroot()
PACKAGE = str(ABOUT.findtext("name"))
DEPENDENCIES = tuple(str(node.text) for node in ABOUT.findall("depend"))  # with the indirect ones
MESSAGES = [path.relative_to(SOURCE) for path in sorted((SOURCE / "msg").glob("*.msg"))]
SERVICES = [path.relative_to(SOURCE) for path in sorted((SOURCE / "srv").glob("*.srv"))]
INTERFACES = [*MESSAGES, *SERVICES]

FASTRTPS = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
DISPATCH = "rosidl_typesupport_c"
STRUCTS = "rosidl_generator_c"
PYTHON = "rosidl_generator_py"
HASHES = "rosidl_generator_type_description"
RUNTIME_LIBRARIES = (
    FASTRTPS,
    "rosidl_typesupport_fastrtps_cpp",
    INTROSPECTION,
    DISPATCH,
    "rosidl_runtime_c",
    "rmw",
    "rcutils",
    "fastcdr",
)


def wheels_prefix() -> Path:
    """The folder that holds lib/, share/ and include/ of the ROS wheels.

    Not always sys.prefix: under pip's build isolation the wheels lie in an overlay of their own.
    """
    found = importlib.util.find_spec(STRUCTS)
    if found is None or found.origin is None:
        sys.exit(f"{PACKAGE}: the ROS wheels are not installed; use build isolation, or install them first")
    for folder in Path(found.origin).parents:
        if (folder / "share" / STRUCTS / "resource").is_dir():
            return folder
    sys.exit(
        f"{PACKAGE}: no templates beside the generators in {Path(found.origin).parent}; "
        "the ROS wheels are broken, install them again"
    )


class Generators:
    """Runs the rosidl generators; each writes to a folder of its own, as their file names clash."""

    def __init__(self, prefix: Path, output: Path) -> None:
        self.prefix, self.output = prefix, output
        self.idl = output / "idl"
        self.idl_files = [interface.with_suffix(".idl").as_posix() for interface in INTERFACES]

    def run(self) -> None:
        convert_message = importlib.import_module("rosidl_adapter.msg").convert_msg_to_idl
        convert_service = importlib.import_module("rosidl_adapter.srv").convert_srv_to_idl
        for interface in INTERFACES:
            convert = convert_message if interface in MESSAGES else convert_service
            convert(SOURCE, PACKAGE, interface, self.idl / interface.parent)
        interfaces = [f"{name}:{self.prefix / 'share' / name}" for name in DEPENDENCIES]
        self._call(HASHES, "generate_type_hash", include_paths=interfaces)
        hashes = self.output / HASHES / PACKAGE
        self._call(
            STRUCTS,
            "generate_c",
            type_description_tuples=[f"{file}:{hashes / file[:-4]}.json" for file in self.idl_files],
            ros_interface_files=[str(SOURCE / interface) for interface in INTERFACES],
        )
        self._call(FASTRTPS, "generate_typesupport_fastrtps_c")
        self._call(INTROSPECTION, "generate_c")
        self._call(DISPATCH, "generate_c", [FASTRTPS, INTROSPECTION])
        self._call(PYTHON, "generate_py", [DISPATCH])

    def _call(self, generator: str, function: str, *more: object, **settings: object) -> None:
        templates = self.prefix / "share" / generator / "resource"
        target = self.output / generator / PACKAGE
        for folder in {"msg", *(str(interface.parent) for interface in INTERFACES)}:
            (target / folder / "detail").mkdir(parents=True)
        for template in templates.glob("*visibility_control.h.in"):  # CMake's configure_file
            text = template.read_text().replace("@PROJECT_NAME_UPPER@", PACKAGE.upper())
            header = target / "msg" / template.name.removesuffix(".in")
            header.write_text(text.replace("@PROJECT_NAME@", PACKAGE))
        arguments = self.output / f"{generator}.json"
        arguments.write_text(
            json.dumps(
                {
                    "package_name": PACKAGE,
                    "output_dir": str(target),
                    "template_dir": str(templates),
                    "idl_tuples": [f"{self.idl}:{file}" for file in self.idl_files],
                    "target_dependencies": [],
                    **settings,
                }
            )
        )
        getattr(importlib.import_module(generator), function)(str(arguments), *more)

    def sources(self, *generators: str) -> list[str]:
        """The C and C++ files that these generators wrote."""
        files = (p for name in generators for p in (self.output / name).rglob("*") if p.is_file())
        return sorted(str(p) for p in files if p.suffix in (".c", ".cpp"))

    def include_folders(self) -> list[str]:
        own = [self.output / name for name in (STRUCTS, DISPATCH, FASTRTPS, INTROSPECTION)]
        shared = self.prefix / "include"
        return [str(p) for p in (*own, shared, *sorted(p for p in shared.iterdir() if p.is_dir()))]


class BuildExtension(build_ext):
    """Generates, compiles and links; `build_extension` runs once, for the one extension module."""

    def build_extension(self, ext: Extension) -> None:
        prefix = wheels_prefix()
        os.environ.setdefault("AMENT_PREFIX_PATH", str(prefix))  # the generators look packages up
        output = Path(self.build_temp).resolve() / "rosidl"
        package = Path(self.get_ext_fullpath(ext.name)).parent
        for folder in (output, package):  # else messages that were renamed would be packed again
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        generators = Generators(prefix, output)
        generators.run()
        self._compile_in_parallel()
        self._link(ext, generators, prefix, package)
        self._copy_python(generators, package)

    def _link(self, ext: Extension, generators: Generators, prefix: Path, package: Path) -> None:
        present = {p.name for p in (prefix / "lib").glob("lib*.so")}
        kinds = (STRUCTS, PYTHON, DISPATCH, FASTRTPS, INTROSPECTION)
        wanted = [f"{name}__{kind}" for name in DEPENDENCIES for kind in kinds]
        libraries = [name for name in (*wanted, *RUNTIME_LIBRARIES) if f"lib{name}.so" in present]
        includes = generators.include_folders()
        ext.library_dirs = [str(package), str(prefix / "lib")]
        # beside the module, and <prefix>/lib as seen from <prefix>/lib/pythonX.Y/site-packages/<package>
        ext.runtime_library_dirs = ["$ORIGIN", "$ORIGIN/../../.."]
        own: list[str] = []
        for kind, sources in (
            (FASTRTPS, generators.sources(STRUCTS, FASTRTPS)),
            (INTROSPECTION, generators.sources(INTROSPECTION)),
        ):
            objects = self.compiler.compile(
                sources,
                output_dir=self.build_temp,
                include_dirs=includes,
                extra_postargs=ext.extra_compile_args,
            )
            file = f"lib{PACKAGE}__{kind}.so"
            self.compiler.link_shared_object(
                objects,
                str(package / file),
                libraries=[*own, *libraries],
                target_lang="c++",
                library_dirs=ext.library_dirs,
                runtime_library_dirs=ext.runtime_library_dirs,
                extra_postargs=[f"-Wl,-soname,{file}"],
            )
            own.append(f"{PACKAGE}__{kind}")
        numpy_headers = importlib.import_module("numpy").get_include()
        ext.sources = generators.sources(DISPATCH, PYTHON)
        ext.include_dirs = [*includes, numpy_headers, sysconfig.get_paths()["include"]]
        ext.libraries = [*own, *libraries]
        ext.extra_link_args = ["-Wl,--no-as-needed", *(f"-l{name}" for name in own), "-Wl,--as-needed"]
        super().build_extension(ext)

    def _copy_python(self, generators: Generators, package: Path) -> None:
        root = generators.output / PYTHON / PACKAGE
        for module in root.rglob("*.py"):
            target = package / module.relative_to(root)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(module, target)
        (package / "__init__.py").touch()
        for interface in INTERFACES:  # bag readers and viewers parse the definitions
            shutil.copyfile(SOURCE / interface, package / interface)

    def _compile_in_parallel(self) -> None:
        compile_some = self.compiler.compile

        def compile_all(sources: list[str], **settings: object) -> list[str]:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                lists = pool.map(lambda source: compile_some([source], **settings), sources)
                return [file for files in lists for file in files]

        self.compiler.compile = compile_all


class BuildPython(build_py):
    """The Python files come out of the generators, so the extension is built first."""

    def run(self) -> None:
        self.run_command("build_ext")
        super().run()


setup(
    packages=[PACKAGE],
    package_dir={PACKAGE: "resource"},  # holds no Python file: BuildExtension writes them all
    include_package_data=False,
    ext_modules=[
        Extension(
            f"{PACKAGE}.{PACKAGE}_s__{DISPATCH}",
            sources=[],
            language="c++",
            extra_compile_args=["-O1", "-g0", "-w"],
        )
    ],
    cmdclass={"build_ext": BuildExtension, "build_py": BuildPython},
    data_files=[
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/msg", [str(message) for message in MESSAGES]),
        (f"share/{PACKAGE}/srv", [str(service) for service in SERVICES]),
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
    ],
)

"""A host for co-simulation units of FMI 2.0, from the standard alone: zip, XML, and the functions of
the shared library. It is independent of Servotwin."""

import ctypes
import ctypes.util
import pathlib
import tempfile
import xml.etree.ElementTree as ElementTree
import zipfile

REAL, REF, INT = ctypes.c_double, ctypes.c_uint, ctypes.c_int
OK, WARNING, DISCARD, ERROR = 0, 1, 2, 3
CO_SIMULATION = 1

LOGGER = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, INT, ctypes.c_char_p,
                          ctypes.c_char_p, ctypes.c_char_p)
ALLOCATE = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t, ctypes.c_size_t)
FREE = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
FINISHED = ctypes.CFUNCTYPE(None, ctypes.c_void_p, INT)


class Callbacks(ctypes.Structure):
    _fields_ = [("logger", LOGGER), ("allocate", ALLOCATE), ("free", FREE),
                ("finished", FINISHED), ("environment", ctypes.c_void_p)]


class Refused(Exception):
    """An error of a function that did not return fmi2OK: its status and the logged message."""

    def __init__(self, status, message):
        super().__init__(f"status {status}: {message}")
        self.status = status
        self.message = message


class Unit:
    """An unpacked unit: its description and its files."""

    def __init__(self, file):
        self._folder = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self._folder.name)
        with zipfile.ZipFile(file) as archive:
            assert archive.testzip() is None
            self.names = archive.namelist()
            self.times = {one.date_time for one in archive.infolist()}
            archive.extractall(self.folder)
        self.description = ElementTree.parse(self.folder / "modelDescription.xml").getroot()
        self.co_simulation = self.description.find("CoSimulation")
        self.identifier = self.co_simulation.get("modelIdentifier")
        self.variables = {v.get("name"): v for v in
                          self.description.find("ModelVariables").findall("ScalarVariable")}
        self.step = float(self.description.find("DefaultExperiment").get("stepSize"))

    def close(self):
        self._folder.cleanup()

    @property
    def library(self):
        return self.folder / "binaries" / "linux64" / (self.identifier + ".so")

    def reference(self, name):
        return int(self.variables[name].get("valueReference"))


class Instance:
    """One instance of the unit, by its own library or another one made from its sources."""

    def __init__(self, unit, library=None, guid=None, resources=None, kind=CO_SIMULATION):
        self.unit = unit
        self.heard = []
        self.memory = {}
        self._library = ctypes.CDLL(str(library or unit.library))
        self._library.fmi2Instantiate.restype = ctypes.c_void_p
        # The memory is the host's: what is not given back shows.
        libc = ctypes.CDLL(None)
        libc.calloc.restype = ctypes.c_void_p
        libc.calloc.argtypes = [ctypes.c_size_t, ctypes.c_size_t]
        libc.free.argtypes = [ctypes.c_void_p]

        def allocate(count, size):
            at = libc.calloc(count, size)
            self.memory[at] = count * size
            return at

        def free(at):
            del self.memory[at]
            libc.free(at)

        def log(_environment, _name, _status, _category, form, text):
            assert form == b"%s"
            self.heard.append(text.decode())

        self._callbacks = Callbacks(LOGGER(log), ALLOCATE(allocate), FREE(free),
                                    FINISHED(lambda *_: None), None)
        if resources is None:
            resources = (unit.folder / "resources").as_uri()
        if guid is None:
            guid = unit.description.get("guid")
        self._component = self._library.fmi2Instantiate(
            b"tested", kind, guid.encode(), resources.encode(),
            ctypes.byref(self._callbacks), 0, 0)
        if not self._component:
            raise Refused(ERROR, self.heard[-1])

    def call(self, name, *arguments):
        function = getattr(self._library, "fmi2" + name)
        status = function(ctypes.c_void_p(self._component), *arguments)
        if status != OK:
            raise Refused(status, self.heard[-1])

    def set(self, **values):
        for name, value in values.items():
            self.set_reference(self.unit.reference(name.replace("__", ".")), value)

    def set_reference(self, reference, value):
        self.call("SetReal", (REF * 1)(reference), ctypes.c_size_t(1), (REAL * 1)(value))

    def set_derivatives(self, name, *values):
        count = len(values)
        self.call("SetRealInputDerivatives", (REF * count)(*[self.unit.reference(name)] * count),
                  ctypes.c_size_t(count), (INT * count)(*range(1, count + 1)),
                  (REAL * count)(*values))

    def get(self, name):
        value = (REAL * 1)()
        self.call("GetReal", (REF * 1)(self.unit.reference(name)), ctypes.c_size_t(1), value)
        return value[0]

    def begin(self, command, start=0.0, **values):
        self.call("SetupExperiment", INT(0), REAL(0), REAL(start), INT(0), REAL(0))
        self.call("EnterInitializationMode")
        self.set(command=command, **values)
        self.call("ExitInitializationMode")

    def do_step(self, at, step=None):
        self.call("DoStep", REAL(at), REAL(self.unit.step if step is None else step), INT(1))

    def keep_state(self):
        state = ctypes.c_void_p()
        self.call("GetFMUstate", ctypes.byref(state))
        return state

    def free_state(self, state):
        self.call("FreeFMUstate", ctypes.byref(state))

    def serialized(self, state):
        size = ctypes.c_size_t()
        self.call("SerializedFMUstateSize", state, ctypes.byref(size))
        data = ctypes.create_string_buffer(size.value)
        self.call("SerializeFMUstate", state, data, size)
        return data.raw

    def deserialized(self, data):
        state = ctypes.c_void_p()
        self.call("DeSerializeFMUstate", data, ctypes.c_size_t(len(data)), ctypes.byref(state))
        return state

    def free(self):
        self._library.fmi2FreeInstance(ctypes.c_void_p(self._component))
        self._component = None

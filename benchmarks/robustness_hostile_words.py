"""Hostile words of a command line: those that must be refused, and those that may be refused or carried out."""

REFUSED, EITHER = "refused", "either"
SPOILT: dict[type, dict[str, tuple[str, ...]]] = {
    bool: {REFUSED: ("banana", "3", "[]", "{a: 1}", "nan")},
    float: {
        REFUSED: ("banana", "nan", "{a: 1}", "[1,[2]]", "'7; touch executed'"),
        EITHER: ("inf", "-1", "0", "1e308", "-1e308", "1e-308", "true", "null", "1000000000000000000000",
                 "1e12", "-1e12", "1e-12", "1000000000"),
    },
    str: {
        EITHER: (
            "{a: 1}", "../../elsewhere", "'$(touch executed)'", "'`touch executed`'", '"a\x1b[2J\x07b"',
            '"a\nb"', "nan", "[]",
            "''", "'" + 300 * "x" + "'", "船", "manoeuvre_nn.core.writing.write_file",
        )
    },
    list: {EITHER: ("banana", "[]", "{a: 1}", "[[[]]]", "[null]", "[nan]", "[1e308]", "7", "[" + "1," * 5000 + "1]")},
    type(None): {EITHER: ("banana", "{a: 1}", "[-1]", "nan", "-1", "1e308", "1e12", "1e-12", "../../elsewhere")},
}  # fmt: skip
"""Kind of a setting's value -> what is written instead."""
ANY: dict[str, tuple[str, ...]] = {
    REFUSED: ("${nosuch}", "${nosuch:1}", "{{key}}"),
    EITHER: (
        "${oc.env:HOME}", "'${oc.env:SECRET}'", "${oc.decode:'{_target_: os.system}'}", "[{_target_: os.system}]", "",
        "{_target_: os.system, command: 'touch executed'}",
    ),
}  # fmt: skip
"""What is written for a value of any kind; ``{{key}}`` is a setting that refers to itself."""
GRAMMAR: dict[str, tuple[str, ...]] = {
    REFUSED: (
        "shipp=mariner", "~nosuch", "=3", "banana", "'", '"', "a=[", "a={b:", "a=${", "seed=1,2", "\x1b[31m=1",
        "a\nb=1", "船=1",
        "seed=range(0,3)", "seed=choice(1,2)", "--nosuch", "-x", "--config-path=.", "--config-name=x", "--config-dir",
        "--config-dir=nowhere", "--experimental-rerun=x.pickle", "--info=banana", "--cfg=banana",
        "config_dir=nowhere",
        "hydra.searchpath=[file://.]", "hydra/launcher=nosuch", "hydra/sweeper=nosuch", "hydra/job_logging=nosuch",
        "config_dir=/dev/zero", "config_dir=loop", "plugins=nosuch", "plugins=[../evil]", "plugins={a: 1}",
        "plugins=os.path.nosuch", "hydra.job.chdir=banana",
    ),
    EITHER: (
        "+foo=1", "++foo.bar=1", "seed==1", "+" + 5000 * "x" + "=1", "", "+a=" + 400 * "[" + 400 * "]", "~seed",
    ),
}  # fmt: skip
"""Words that hydra's grammar or its command line make something of."""
GROUPS = ("ship", "linear", "network", "fit", "manoeuvre", "effect", "data", "scoring", "trainer", "experiment")
OPTIONS: dict[str, tuple[str, ...]] = {
    REFUSED: ("submarine", "/etc/passwd", "[mariner,nosuch]", "7", "{a: 1}", '"a\x1b[2Jb"'),
    EITHER: ("../ship/mariner", "mariner.yaml", "''"),
}
"""What is chosen of a group."""
FILES = {
    "train": ("effects={}", "trainer.resume={}", "config_dir={}", "out={}", "score=[{}]"),
    "train recordings": ("data.folder={}", "data.files=[{}]", "data.mapping={}", "score=[{}]"),
    "simulate": ("effects={}", "out={}", "config_dir={}"),
    "diagnose": ("recordings={}", "mapping={}", "model={}", "files=[{}]", "out={}", "held_out=[{}]"),
    "diagnose cases": ("cases={}", "model={}", "out={}"),
    "check": ("data.folder={}", "data.mapping={}", "data.files=[{}]", "out={}"),
    "import": ("out={}", "name={}", "config_dir={}", "{}"),
    "coefficients": ("run={}", "captive.file={}", "captive.mapping={}"),
    "excite": ("model={}", "effects={}"),
    "export": ("run={}", "out={}", "config_dir={}"),
}
"""Settings that name files and folders."""
PATHS = (
    "nowhere", "/dev/zero", "/dev/full", "fifo", "loop", "empty", "binary", "folder", "''", "..",
    "/proc/self/mem", "/nowhere/x",
    "'" + 300 * "x" + "'", "'" + 5000 * "x/" + "'", '"a\x1b[2J\nb"', "'*'", "'/**'", "'~'", "船", "dangling",
    "bomb.yaml",
)  # fmt: skip
"""What stands in an attack's folder, or nowhere."""
TOGETHER: dict[str, dict[str, tuple[str, ...]]] = {
    "train": {
        REFUSED: (
            "score=[zz35]", "ship=kvlcc2", "fit=closed_loop", "data.length=1", "trainer.resume=out",
            "trainer.accelerator=gpu",
            "trainer.accelerator=tpu", "network.hidden=1000000000", "data.rate_hz=1e300",
            "network.hidden=[1000000,1000000]",
            "trainer.threads=1000000", "manoeuvre=[]", "manoeuvre=[zz35,tc25]", "task=nosuch", "task=",
        ),
        EITHER: (
            "score=[{zz20: {duration: 60}},{zz20: {duration: 60}}]", "effect=[current,current]",
            "scoring.every=1000000000000",
        ),
    },
    "train ensemble": {REFUSED: ("network.members=1000000000", "fit=levenberg_marquardt")},
    "train series": {
        REFUSED: ("network.surge=[os.system]", "network.lateral=['__import__(\"os\")']"),
        EITHER: (
            "network.surge=[u u,u u]", "network.surge=[]", "network.surge=[u u u u u u u u u u u u u u]",
            "fit.floor=[0,0,0,0,0,0]",
        ),
    },
    "train pitch": {
        REFUSED: (
            "network=wang", "learning=7",
            "inputs.T.values=[" + ",".join(map(str, range(1, 31))) + "] data.between=1000000000",
        ),
        EITHER: ("learning=1.0",),
    },
    "train recordings": {
        REFUSED: ("score=[zz20.csv]", "effect=[current]", "data.files=[]"), EITHER: ("ship=container",),
    },
    "simulate": {
        REFUSED: (
            "ship=kvlcc2", "manoeuvre.zz20.duration=1e15", "rate_hz=1e15", "manoeuvre.speed_kn=1e15",
            "manoeuvre.zz20.duration=nan", "manoeuvre.zz20.duration=0",
        ),
        EITHER: ("manoeuvre=[zz20,zz20]", "noise.u=1e308"),
    },
    "diagnose": {
        REFUSED: (
            "candidates=[nosuch]", "workers=0", "workers=-1", "workers=1000000", "cases=.",
            "held_out=[zz20,tc25]", "rpm=nan",
            "speed_kn=-1", "warmup_s=1e9",
        ),
        EITHER: ("candidates=[]", "ship=kvlcc2"),
    },
    "diagnose cases": {REFUSED: ("ship=mariner", "workers=1.5")},
    "check": {REFUSED: ("data.files=[nosuch*]", "figures=7"), EITHER: ("ship=kvlcc2",)},
    "import": {REFUSED: ("ship=submarine", "overwrite=perhaps", "name=../x", "name=a", "second.csv",
    "plugins=nosuch")},
    "coefficients": {
        REFUSED: ("inertia={mx: nan}", "inertia={mx: 0, my: 0, mz: 0, Yrdot: 0, Nvdot: 0}"),
        EITHER: ("terms=own ship=kvlcc2",),
    },
    "excite": {
        REFUSED: (
            "score=[]", "candidates=[]", "candidates=[kvlcc2]",
            "effort={truths: 0, others: 0, samples: 0}",
        ),
        EITHER: (
            "candidates=[zz20,zz20]", "goal=coefficients network.members=1",
            "effort={truths: 1000000000, others: 2, samples: 50}",  # all members
        ),
    },
    "export": {REFUSED: ("format=exe", "document=perhaps", "run=null")},
    "sweep": {
        REFUSED: ("ship=mariner,submarine", "out=/dev/null"),
        EITHER: ("seed=", "network.hidden=2,banana", "hydra.sweep.subdir=../../x"),
    },
}  # fmt: skip
"""Settings that contradict each other or the legal command's, and sizes that no machine has."""
SCRIPTS = {
    "scripts/concealed_trial.py": (
        "cases={}", "seed={}", "jobs={}", "nuisance={}", "sort={}", "strength={}", "channels={}", "methods={}",
        "strict={}",
        "loop={}", "{}", "nosuch={}",
    ),
    "scripts/rivals.py": (
        "method={}", "cases={}", "calibrate={}", "train={}", "clean={}", "{}", "nosuch={}", "model={}",
    ),
    "scripts/reproduce.py": (
        "paper={}", "chapters={}", "workers={}", "quick={}", "starts={}", "seed={}", "nosuch={}", "{}",
    ),
}  # fmt: skip
"""Settings of the scripts that are no commands."""
WORTHLESS = (
    "", "-1", "1.5", "nan", "banana", "'", "../x", "a\x1b[2Jb", "a\nb", "²", "1e9", "null", "/dev/zero",
    "${oc.env:HOME}",
)  # fmt: skip
"""What is written there."""

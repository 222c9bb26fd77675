"""The bytes of results under the settings that this machine's processor lacks, on one that Bochs
emulates, as reports/benchmarks/emulated.json: ``python tests/benchmarks/emulated.py FOLDER``.

The guest has Debian's kernel, this Python with its environment and a copy of the project in which
nothing is compiled. Needs, on Debian, mke2fs, xorriso, apt-get, dpkg-deb and on the path ``bochs``
3.0, configured with ``--with-nogui --disable-plugins --enable-x86-64 --enable-avx --enable-evex
--enable-all-optimizations --enable-pci``. It takes the better part of an hour.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from equal_bytes import Setting, lacking

sys.path.append(str(Path(__file__).parents[1]))
from project_copy import ROOT, copy_project

PROCESSOR = "corei7_skylake_x"  # as Bochs names it; has x86-64-v4
KERNEL = "linux-image-amd64"
PACKAGES = ("busybox-static", "isolinux", "syslinux-common", "bochsbios", "vgabios")
DRIVERS = ("crc32c_generic", "ata_piix", "sd_mod", "ext4")
UNUSED = ("open3d", "playwright", "plotly", "dash", "scs")  # by what is computed; large
COPIES = "/levels"  # of the project, in the guest
PORT = "/dev/ttyS1"  # through which the answer leaves the guest
FIRST = """#!/bin/busybox sh
/bin/busybox mount -t proc none /proc
busybox mount -t devtmpfs none /dev
for driver in /drivers/*; do busybox insmod $driver; done
busybox sleep 2
busybox mount -t ext4 /dev/sda /disk
for kept in proc dev; do busybox mount --move /$kept /disk/$kept; done
exec busybox chroot /disk /bin/busybox sh /run.sh
"""
BOOT = """DEFAULT guest
LABEL guest
 KERNEL /kernel
 APPEND initrd=/initrd console=ttyS0 loglevel=0 mitigations=off random.trust_cpu=on panic=1
"""


def debian(folder: Path) -> Path:
    """Below ``folder`` the kernel and what boots it, unpacked."""
    depends = subprocess.check_output(["apt-cache", "depends", KERNEL], text=True)
    kernel = re.search(r"Depends: (linux-image-\S+)", depends)[1]
    subprocess.run(["apt-get", "download", "-q", kernel, *PACKAGES], cwd=folder, check=True)
    for package in folder.glob("*.deb"):
        subprocess.run(["dpkg-deb", "-x", package, folder / "debian"], check=True)
    return folder / "debian"


def in_order(modules: dict[str, Path], wanted: tuple[str, ...]) -> list[str]:
    """Kernel modules, each after those that it depends on; {name: file}."""
    order: list[str] = []
    for name in wanted:
        depends = re.search(rb"\0depends=([^\0]*)\0", modules[name].read_bytes())[1].decode()
        needed = tuple(part for part in depends.split(",") if part)
        order += [one for one in (*in_order(modules, needed), name) if one not in order]
    return order


def boot_disc(system: Path, folder: Path) -> None:
    """``folder``/boot.iso: the kernel, and a first disk with the drivers of the other one."""
    first, disc = folder / "first", folder / "disc"
    for part in ("bin", "drivers", "proc", "dev", "disk"):
        (first / part).mkdir(parents=True)
    shutil.copy2(system / "bin/busybox", first / "bin")
    files = {file.stem: file for file in system.rglob("*.ko")}
    for number, name in enumerate(in_order(files, DRIVERS)):
        shutil.copy2(files[name], first / f"drivers/{number:02}_{name}.ko")
    (first / "init").write_text(FIRST)
    (first / "init").chmod(0o755)
    disc.mkdir()
    packed = f"find . | bin/busybox cpio -o -H newc | gzip > {shlex.quote(str(disc / 'initrd'))}"
    subprocess.run(packed, shell=True, cwd=first, check=True)
    shutil.copy2(next(system.glob("boot/vmlinuz-*")), disc / "kernel")
    for file in ("ISOLINUX/isolinux.bin", "syslinux/modules/bios/ldlinux.c32"):
        shutil.copy2(system / "usr/lib" / file, disc)
    (disc / "isolinux.cfg").write_text(BOOT)
    boot = "-b isolinux.bin -c boot.cat -no-emul-boot -boot-load-size 4 -boot-info-table".split()
    made = ["xorriso", "-as", "mkisofs", "-quiet", "-o", folder / "boot.iso", *boot, disc]
    subprocess.run(made, check=True)


def libraries(below: Path) -> set[Path]:
    """The system's shared libraries that files below a folder ask for."""
    files = [file for file in below.rglob("*.so*") if file.is_file() and not file.is_symlink()]
    asked = subprocess.run(["ldd", sys.executable, *files], capture_output=True, text=True)
    return {Path(path) for path in re.findall(r"\s(/(?:usr/)?lib\S+) \(", asked.stdout)}


def run(settings: list[Setting]) -> str:
    """What the guest runs."""
    levels = sorted({one.level for one in settings})
    program = (
        "import json; from pathlib import Path; from equal_bytes import SETTINGS, measured; "
        f"settings = [one for one in SETTINGS if one.level in {levels}]; "
        f"answer = measured(settings, Path({COPIES!r})); "
        f"Path({PORT!r}).write_text(json.dumps(answer))"
    )
    return f"""export HOME=/tmp
for memory in /tmp /dev/shm; do
  busybox mkdir -p $memory; busybox mount -t tmpfs none $memory
done
busybox ip link set lo up
cd {COPIES}/{levels[0]}/tests/benchmarks
{sys.executable} -c {shlex.quote(program)}
busybox poweroff -f
"""


def disk(system: Path, folder: Path, settings: list[Setting]) -> None:
    """``folder``/disk.img: Python, the environment, the libraries of both, copies of the project
    and what is run.
    """
    tree = folder / "tree"
    for prefix in (sys.base_prefix, sys.prefix):
        left_out = shutil.ignore_patterns(*UNUSED)
        shutil.copytree(prefix, tree / prefix[1:], symlinks=True, ignore=left_out)
    for level in {one.level for one in settings}:
        copy_project(tree / COPIES[1:] / level)
    for library in libraries(tree):
        copy = tree / library.relative_to("/")
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(library, copy)
    for part in ("bin", "proc", "dev", "tmp"):
        (tree / part).mkdir(exist_ok=True)
    shutil.copy2(system / "bin/busybox", tree / "bin")
    (tree / "run.sh").write_text(run(settings))
    image = folder / "disk.img"  # sparse
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", tree, image, "4G"], check=True)


def description(system: Path, folder: Path) -> str:
    """Of the guest, as Bochs reads it."""
    share = system / "usr/share"
    return f"""cpu: model={PROCESSOR}, ips=300000000, reset_on_triple_fault=0
memory: guest=2048, host=2048
romimage: file={share}/bochs/BIOS-bochs-latest
vgaromimage: file={share}/vgabios/vgabios.bin
pci: enabled=1, chipset=i440fx
ata0: enabled=1, ioaddr1=0x1f0, ioaddr2=0x3f0, irq=14
ata1: enabled=1, ioaddr1=0x170, ioaddr2=0x370, irq=15
ata0-master: type=disk, path={folder}/disk.img, mode=flat
ata1-master: type=cdrom, path={folder}/boot.iso, status=inserted
boot: cdrom
com1: enabled=1, mode=file, dev={folder}/console.txt
com2: enabled=1, mode=file, dev={folder}/answer.json
display_library: nogui
clock: sync=none
log: {folder}/bochs.txt
info: action=ignore
error: action=ignore
"""


def main(folder: Path) -> None:
    """Build the guest, run it and write; RuntimeError without need, emulator or answer."""
    settings = lacking()
    if not settings:
        raise RuntimeError("this processor has all levels: run `make bench`")
    if not shutil.which("bochs"):
        raise RuntimeError("no Bochs on the path: install it as this file's first lines say")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    system = debian(folder)
    boot_disc(system, folder)
    disk(system, folder, settings)
    (folder / "bochsrc").write_text(description(system, folder))
    # it ends with an error where the guest switches itself off, too
    subprocess.run(["bochs", "-q", "-f", folder / "bochsrc"], stdin=subprocess.DEVNULL, check=False)
    answer = folder / "answer.json"
    if not answer.exists():
        raise RuntimeError(f"the guest gave no answer: read {folder}/console.txt and bochs.txt")
    written = json.dumps(json.loads(answer.read_text()), indent=1) + "\n"
    (ROOT / "reports/benchmarks/emulated.json").write_text(written)


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())

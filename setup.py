"""Build the package with colcon or with pip; package.xml says who and what it is."""

from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

HERE = Path(__file__).resolve().parent
MANIFEST = ElementTree.parse(HERE / 'package.xml').getroot()
NAME = MANIFEST.findtext('name')
MAINTAINER = MANIFEST.find('maintainer')


def data(folder):
    """Return the data_files entry that installs every file of `folder`."""
    files = sorted(path for path in glob(f'{folder}/*') if Path(path).is_file())
    return f'share/{NAME}/{folder}', files


setup(
    name=NAME,
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    license=MANIFEST.findtext('license'),
    maintainer=MAINTAINER.text,
    maintainer_email=MAINTAINER.get('email'),
    packages=find_packages(include=[NAME, f'{NAME}.*'], exclude=['test']),
    package_data={NAME: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        data('config'),
        data('config/robots'),
        data('examples'),
        data('launch'),
        data('recordings'),
        (f'share/{NAME}/security', ['security/hand_tracker.policy.xml']),
        data('urdf'),
    ],
    zip_safe=False,
    python_requires='>=3.10',
    install_requires=[
        'joblib',
        'matplotlib',
        'numpy',
        'pillow',
        'pyyaml',
        'rosbags',
        'scipy',
        'setuptools',
    ],
    extras_require={
        'cluster': ['distributed', 'fsspec'],
        'fast': ['numba'],
        'mujoco': ['mujoco'],
        'qualisys': ['qtm-rt'],
        'test': [
            'bvhio',
            'c3d',
            'distributed',
            'ezc3d',
            'filterpy',
            'fsspec',
            'hypothesis',
            'mcap-ros2-support',
            'natnet',
            'pin',
            'playwright',
            'psutil',
            'pygltflib',
            'pytest',
            'pytest-timeout',
            'qtm-rt',
            'yourdfpy',
        ],
        'view': [
            'scikit-image',
            'trimesh',
            'viser',
        ],
    },
    entry_points={
        'console_scripts': [
            'all = hand_tracker.entry:all_nodes',
            'calibrate = hand_tracker.entry:calibrate',
            'hand_tracker = hand_tracker.__main__:main',
            'landmarks = hand_tracker.entry:landmarks',
            'managed_tracker = hand_tracker.entry:managed_tracker',
            'mount = hand_tracker.entry:mount',
            'replay = hand_tracker.entry:replay',
            'retarget = hand_tracker.entry:retarget',
            'simulate = hand_tracker.entry:simulate',
            'skin = hand_tracker.entry:skin',
            'source = hand_tracker.entry:source',
            'teleoperate = hand_tracker.entry:teleoperate',
            'tracker = hand_tracker.entry:tracker',
            'viewer = hand_tracker.entry:viewer',
        ],
    },
)
